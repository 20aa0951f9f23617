"""Search spaces: what they hold, what is refused, and what comes from trials and files."""

from __future__ import annotations

import copy
import json
import pickle

import optuna
import pytest
from optuna.trial import FixedTrial

from sb3_piano.exceptions import ConfigError
from sb3_piano.tuning.search_space.built_in import SPACES
from sb3_piano.tuning.search_space.defaults import with_defaults
from sb3_piano.tuning.search_space.parsing import Choice, Discount, Float, Int
from sb3_piano.tuning.search_space.space import Space, load_space

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STRETCH = "sb3_piano.wrappers.TemporalStretch"
SCALE = "gymnasium.wrappers.RescaleAction"
ENTRY = {"n_timesteps": 100, "policy": "MlpPolicy"}


def test_a_space_is_a_mapping_that_survives_json_and_pickle():
    space = Space(
        {
            "learning_rate": Float(1e-4, 1e-2, log=True),
            "gamma": Discount(0.6, 0.97),
            "batch_size": {"choice": [64, 128]},
            "policy_kwargs.net_arch": Choice({"small": [64], "large": [256, 256]}),
            "env_kwargs.n_steps_lookahead": {"int": [1, 9], "step": 2},
        }
    )
    assert list(space) == [
        "learning_rate", "gamma", "batch_size", "policy_kwargs.net_arch",
        "env_kwargs.n_steps_lookahead",
    ]  # fmt: skip
    assert space["env_kwargs.n_steps_lookahead"] == Int(1, 9, step=2)
    again = Space.from_mapping(json.loads(json.dumps(space.to_mapping())))
    assert again == space == pickle.loads(pickle.dumps(space)) == copy.deepcopy(space)
    assert list(again.distributions) == list(space.distributions)
    assert again.distributions == space.distributions


def test_a_trial_and_what_is_stored_of_it_give_the_same_settings():
    space = Space({"tau": Float(0, 1), "gamma": Discount(0, 0.9), "net": Choice([[8], [16]])})
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=1))
    trial = study.ask()
    settings = space.suggest(trial)
    assert settings.keys() == space.keys()
    params = study.trials[0].params
    assert params.keys() == {"tau", "1 - gamma", "net"} == space.distributions.keys()
    assert study.trials[0].distributions == space.distributions
    assert space.settings(params) == settings
    assert space.settings({"tau": 0.5, "other": 1}) == {"tau": 0.5}


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({}, r"^Search space: \{\} has no parameter: expected a mapping"),
        ([("tau", Float(0, 1))], r"^Search space: \[.* has no parameter: expected a mapping"),
        ({3: Float(0, 1)}, "^Search space: 3 is no name of a setting: expected a path"),
        ({"1 - gamma": Float(0, 1)}, "^Search space: '1 - gamma' is no name of a setting"),
        ({"env_kwargs.": Float(0, 1)}, "^Search space: 'env_kwargs.' is no name of a setting"),
        ({"seed": Int(0, 9)}, "^Search space: 'seed' cannot be searched: each trial trains from"),
        ({"n_timesteps": Int(1, 9)}, "'n_timesteps' cannot be searched: all trials have the same"),
        ({"env_id": Choice(["a", "b"])}, "'env_id' cannot be searched: a study has one environ"),
        ({"callback.F1Callback.eval_freq": Int(1, 9)}, "cannot be searched: expected 'callback' a"),
        ({"vec_env_wrapper.V.x": Int(1, 9)}, "cannot be searched: expected 'vec_env_wrapper' as"),
        ({"env_wrapper.TemporalStretch": Int(1, 9)}, "names no argument: expected 'env_wrapper.T"),
        ({"tau": {"float": [1, 0]}}, "^Search space: 'tau': low is 1.0 and high is 0.0"),
    ],
)
def test_a_space_that_makes_no_sense_is_refused(parameters, message):
    with pytest.raises(ConfigError, match=message):
        Space(parameters)


SPACE = Space(
    {
        "learning_rate": Float(1e-4, 1e-2, log=True),
        "gamma": Discount(0.6, 0.97),
        "batch_size": Choice([64, 128]),
        "policy": Choice(["MlpPolicy", "sb3_piano.policies.RegularizedSACPolicy"]),
        "policy_kwargs.net_arch": Choice([[64], [64, 64]]),
        "policy_kwargs.activation_fn": Choice(["nn.ReLU", "nn.Tanh"]),
        "env_kwargs.reward_weights.energy": Float(0, 1),
        "env_wrapper.TemporalStretch.factor": Float(1, 2),
    }
)
SETTINGS = {
    "learning_rate": 0.001,
    "gamma": 0.8,
    "batch_size": 128,
    "policy": "MlpPolicy",
    "policy_kwargs.net_arch": [64, 64],
    "policy_kwargs.activation_fn": "nn.Tanh",
    "env_kwargs.reward_weights.energy": 0.5,
    "env_wrapper.TemporalStretch.factor": 1.5,
}


@pytest.mark.parametrize(
    "entry",
    [
        {},
        {"policy_kwargs": "dict(n_critics=1)", "env_wrapper": [SCALE]},
        {"policy_kwargs": None, "env_kwargs": None, "env_wrapper": None},
        {"env_kwargs": "dict(reward_weights=dict(energy=0))", "env_wrapper": {STRETCH: None}},
    ],
)
def test_the_params_of_an_entry_are_those_that_were_applied(entry):
    params = SPACE.params_of(SPACE.apply({**ENTRY, **entry}, SETTINGS))
    assert SPACE.settings(params) == SETTINGS
    assert params["1 - gamma"] == 0.2
    assert SPACE.suggest(FixedTrial(params)) == SETTINGS


def test_an_enqueued_trial_has_the_settings_of_the_entry():
    entry = SPACE.apply(ENTRY, SETTINGS)
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    study.enqueue_trial(SPACE.params_of(entry))
    assert SPACE.apply(ENTRY, SPACE.suggest(study.ask())) == entry


@pytest.mark.parametrize(
    ("entry", "params"),
    [
        ({}, {}),
        ({"learning_rate": "1e-3", "gamma": "0.8"}, {"learning_rate": 0.001, "1 - gamma": 0.2}),
        ({"learning_rate": "lin_0.001", "gamma": 0.99, "batch_size": 32}, {}),
        ({"policy_kwargs": {"net_arch": (64,)}}, {"policy_kwargs.net_arch": "[64]"}),
        (
            {"policy_kwargs": "dict(activation_fn=torch.nn.Tanh)"},
            {"policy_kwargs.activation_fn": "nn.Tanh"},
        ),
        ({"policy_kwargs": "dict(net_arch=[1])", "env_kwargs": {"reward_weights": None}}, {}),
        ({"env_kwargs": {"reward_weights": 3}, "policy_kwargs": "broken("}, {}),
        ({"env_wrapper": {STRETCH: {"factor": 3}}}, {}),
        ({"env_wrapper": [SCALE, {STRETCH: {}}]}, {}),
    ],
)
def test_what_the_entry_lacks_or_what_lies_outside_is_left_out(entry, params):
    assert SPACE.params_of(entry) == params


def test_with_its_defaults_an_entry_has_what_it_does_not_say():
    space = Space(
        {
            "tau": Float(0.001, 0.01),
            "gamma": Discount(0.6, 0.97),
            "policy": Choice(["MlpPolicy", "sb3_piano.policies.RegularizedSACPolicy"]),
            "env_kwargs.n_steps_lookahead": Int(1, 20),
            "env_kwargs.reward_weights.energy": Float(0, 1),
            "env_kwargs.reward_weights.fingering": Float(0, 1),
        }
    )
    entry = {"n_timesteps": 1, "gamma": 0.9, "env_kwargs": {"reward_weights": {"energy": 0.5}}}
    before = copy.deepcopy(entry)
    assert space.settings(space.params_of(with_defaults("sac", ENV_ID, entry))) == {
        "tau": 0.005,
        "gamma": 0.9,
        "policy": "MlpPolicy",
        "env_kwargs.n_steps_lookahead": 10,
        "env_kwargs.reward_weights.energy": 0.5,
        "env_kwargs.reward_weights.fingering": 1.0,
    }
    assert entry == before


def test_an_environment_that_is_no_piano_has_no_defaults_of_one():
    assert "env_kwargs" not in with_defaults("sac", "Pendulum-v1", {"n_timesteps": 1})


def write(path, text):
    path.write_text(text)
    return str(path)


def test_a_space_comes_from_names_and_files_of_which_the_last_one_counts(tmp_path):
    first = write(tmp_path / "a.yml", "gamma: {float: [0, 0.5]}\nn_steps: {int: [1, 3]}\n")
    second = write(tmp_path / "b.yml", "n_steps: {choice: [1, 2]}\n")
    space = load_space(["sac", first, second], "sac")
    assert space == {**SPACES["sac"], "gamma": Float(0, 0.5), "n_steps": Choice([1, 2])}
    assert load_space([tmp_path / "a.yml"], "sac").keys() == {"gamma", "n_steps"}
    assert load_space([first, "sac"], "a2c")["gamma"] == SPACES["sac"]["gamma"]


def test_without_a_source_it_is_the_space_of_the_algorithm():
    assert load_space([], "tqc") == SPACES["tqc"]
    with pytest.raises(ConfigError, match="^No search space comes with this package for 'a2c':"):
        load_space([], "a2c")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("saq", "^Unknown search space 'saq'. Did you mean 'sac'.* Expected one of td3, .*YAML"),
        ("none.yml", "none.yml' cannot be read: No such file"),
    ],
)
def test_an_unknown_source_is_named(source, message):
    with pytest.raises(ConfigError, match=message):
        load_space([source], "sac")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", r"a.yml': Search space: \{\} has no parameter"),
        ("[]", "a.yml' holds list at the top level"),
        ("tau: {flaot: [0, 1]}", "a.yml': Search space: 'tau': .* Did you mean 'float'"),
        ("tau: 0.5", "a.yml': Search space: 'tau': 0.5 cannot be searched: expected"),
        ("1: {float: [0, 1]}", "a.yml': Search space: 1 is no name of a setting"),
    ],
)
def test_a_file_that_holds_no_space_is_named(tmp_path, text, message):
    path = write(tmp_path / "a.yml", text)
    with pytest.raises(ConfigError, match=message):
        load_space([path], "sac")


def test_a_file_without_ending_is_a_file(tmp_path):
    assert load_space([write(tmp_path / "mine", "tau: {float: [0, 1]}")], "sac") == {
        "tau": Float(0, 1)
    }
