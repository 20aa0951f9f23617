"""Search spaces: what they hold, what is refused, and what comes from trials and files."""

from __future__ import annotations

import copy
import json
import pickle

import gymnasium as gym
import optuna
import pytest
import yaml

from sb3_piano.envs import DEBUG_IDS, DEFAULT_REWARD_WEIGHTS
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import PRESETS
from sb3_piano.training import load_entry
from sb3_piano.training.configuration.names import ALGORITHMS
from sb3_piano.tuning.space import (
    SPACES,
    Space,
    check_space,
    load_space,
    with_defaults,
    with_settings,
)

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STRETCH = "sb3_piano.wrappers.TemporalStretch"
ENTRY = {"n_timesteps": 100, "policy": "MlpPolicy"}
SPACE = Space(
    {
        "learning_rate": {"float": [1e-4, 1e-2], "log": True},
        "gamma": {"discount": [0.6, 0.97]},
        "batch_size": {"choice": [64, 128]},
        "policy_kwargs.net_arch": {"choice": [[64], [64, 64]]},
        "policy_kwargs.activation_fn": {"choice": ["nn.ReLU", "nn.Tanh"]},
        "env_kwargs.n_steps_lookahead": {"int": [1, 9], "step": 2},
        "env_wrapper.TemporalStretch.factor": {"float": [1, 2]},
    }
)
SETTINGS = {
    "learning_rate": 0.001,
    "gamma": 0.8,
    "batch_size": 128,
    "policy_kwargs.net_arch": [64, 64],
    "policy_kwargs.activation_fn": "nn.Tanh",
    "env_kwargs.n_steps_lookahead": 3,
    "env_wrapper.TemporalStretch.factor": 1.5,
}


def test_a_space_is_a_mapping_that_survives_json_and_pickle():
    assert list(SPACE) == list(SETTINGS)
    assert SPACE["gamma"].form == {"discount": [0.6, 0.97]}
    again = Space(json.loads(json.dumps(SPACE.to_mapping())))
    assert again == SPACE == pickle.loads(pickle.dumps(SPACE)) == copy.deepcopy(SPACE)
    assert again.distributions == SPACE.distributions


def test_a_trial_and_what_is_stored_of_it_give_the_same_settings():
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=1))
    trial = study.ask()
    settings = SPACE.suggest(trial)
    assert settings.keys() == SPACE.keys()
    params = study.trials[0].params
    assert params.keys() == SPACE.distributions.keys() == {*SETTINGS, "1 - gamma"} - {"gamma"}
    assert study.trials[0].distributions == SPACE.distributions
    assert SPACE.settings(params) == settings
    assert SPACE.settings({"batch_size": 64, "other": 1}) == {"batch_size": 64}


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({}, r"^Search space: \{\} has no parameter: expected a mapping"),
        ([("tau", 1)], r"^Search space: \[.* has no parameter: expected a mapping"),
        ({3: 1}, "^Search space: 3 is no name of a setting: expected a path"),
        ({"1 - gamma": 1}, "^Search space: '1 - gamma' is no name of a setting"),
        ({"seed": 1}, "^Search space: 'seed' cannot be searched: each trial trains from"),
        ({"callback.F1Callback.eval_freq": 1}, "cannot be searched: expected 'callback' as"),
        ({"env_wrapper.TemporalStretch": 1}, "names no argument: expected 'env_wrapper.T"),
        ({"tau": {"float": [1, 0]}}, "^Search space: 'tau': .* is no range"),
    ],
)
def test_a_space_that_makes_no_sense_is_refused(parameters, message):
    with pytest.raises(ConfigError, match=message):
        Space(parameters)


@pytest.mark.parametrize(
    "entry",
    [
        {},
        {"policy_kwargs": "dict(n_critics=1)", "env_wrapper": ["gymnasium.wrappers.RescaleAction"]},
        {"policy_kwargs": None, "env_kwargs": None, "env_wrapper": None},
    ],
)
def test_an_enqueued_trial_has_the_settings_of_the_entry(entry):
    applied = with_settings({**ENTRY, **entry}, SETTINGS)
    params = SPACE.params_of(applied)
    assert params["1 - gamma"] == 0.2
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    study.enqueue_trial(params)
    assert SPACE.suggest(study.ask()) == SETTINGS


@pytest.mark.parametrize(
    ("entry", "params"),
    [
        ({}, {}),
        ({"learning_rate": "1e-3", "gamma": "0.8"}, {"learning_rate": 0.001, "1 - gamma": 0.2}),
        ({"learning_rate": "lin_0.001", "gamma": 0.99, "batch_size": 32}, {}),
        (
            {"policy_kwargs": "dict(activation_fn=torch.nn.Tanh)"},
            {"policy_kwargs.activation_fn": "nn.Tanh"},
        ),
        ({"env_wrapper": {STRETCH: {"factor": 3}}}, {}),
    ],
)
def test_what_the_entry_lacks_or_what_lies_outside_is_left_out(entry, params):
    assert SPACE.params_of(entry) == params


# Spaces by name and from files.


def write(path, text):
    path.write_text(text)
    return str(path)


def test_a_space_comes_from_names_and_files_of_which_the_last_one_counts(tmp_path):
    first = write(tmp_path / "a.yml", "gamma: {float: [0, 0.5]}\nn_steps: {int: [1, 3]}\n")
    second = write(tmp_path / "without_ending", "n_steps: {choice: [1, 2]}\n")
    space = load_space(["sac", first, second], "sac")
    own = {"gamma": {"float": [0, 0.5]}, "n_steps": {"choice": [1, 2]}}
    assert space == Space({**SPACES["sac"], **own})
    assert load_space([first, "sac"], "a2c")["gamma"] == SPACES["sac"]["gamma"]
    assert load_space([], "tqc") == SPACES["tqc"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "a.yml' cannot be read: No such file"),
        ("{}", r"a.yml': Search space: \{\} has no parameter"),
        ("[]", "a.yml' holds list at the top level"),
        ("tau: {flaot: [0, 1]}", "a.yml': Search space: 'tau': .* Did you mean 'float'"),
    ],
)
def test_a_file_that_holds_no_space_is_named(tmp_path, text, message):
    if text is not None:
        write(tmp_path / "a.yml", text)
    with pytest.raises(ConfigError, match=message):
        load_space([tmp_path / "a.yml"], "sac")


def test_an_unknown_name_is_refused():
    with pytest.raises(ConfigError, match="^Unknown search space 'saq'. Did you mean 'sac'.*YAML"):
        load_space(["saq"], "sac")
    with pytest.raises(ConfigError, match="^No search space comes with this package for 'a2c':"):
        load_space([], "a2c")


# The spaces that come with the package fit algorithms, environments and presets.


def algorithm_of(name: str) -> str:
    return name if name in ALGORITHMS else "sac"


def test_there_is_one_for_each_algorithm_of_the_presets_and_two_for_any():
    assert {*PRESETS, "env", "reward"} == SPACES.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", SPACES)
def test_every_setting_and_range_is_accepted_where_it_enters(name):
    algo = algorithm_of(name)
    check_space(SPACES[name], algo, DEBUG_IDS[1], load_entry(algo, DEBUG_IDS[1]))


@pytest.mark.parametrize("env_id", [DEBUG_IDS[0], DEBUG_IDS[-1]])
@pytest.mark.parametrize("name", SPACES)
def test_the_settings_of_the_debug_presets_lie_inside(name, env_id):
    algo = algorithm_of(name)
    entry = load_entry(algo, env_id)
    space = SPACES[name]
    full = space.params_of(with_defaults(algo, env_id, entry))
    assert full.keys() == space.distributions.keys()
    settings = space.settings(full)
    assert {**settings, **space.settings(space.params_of(entry))} == settings
    assert space.params_of(with_settings(entry, settings)) == full


@pytest.mark.parametrize("name", ["td3", "sac", "tqc", "ddpg"])
def test_the_published_settings_lie_inside(name):
    space = SPACES[name]
    settings = space.settings(space.params_of(load_entry(name, "RoboPianist-v0")))
    assert {"learning_rate", "batch_size"} <= settings.keys()
    assert (settings["gamma"], settings["tau"]) == (0.8, 0.005)
    assert settings["policy_kwargs.net_arch"] == [256, 256, 256]


def test_batches_of_ppo_are_all_full():
    steps, batches = (SPACES["ppo"][name].extremes() for name in ("n_steps", "batch_size"))
    assert all(n % size == 0 for n in steps for size in batches)


def test_rewards_are_searched_around_their_defaults_but_for_the_unit():
    prefix = "env_kwargs.reward_weights."
    terms = {name.removeprefix(prefix) for name in SPACES["reward"]}
    assert terms <= DEFAULT_REWARD_WEIGHTS.keys() - {"key_press"}
    assert "fingering" in terms
    for term in terms:
        low, high = SPACES["reward"][f"{prefix}{term}"].extremes()
        assert low == pytest.approx(DEFAULT_REWARD_WEIGHTS[term] / 10)
        assert high > DEFAULT_REWARD_WEIGHTS[term]


# Spaces are tried out where their settings enter, before anything is trained.


def check(text, entry=None, algo="td3", env_id=ENV_ID):
    entry = {**ENTRY, "env_kwargs": {"n_steps_lookahead": 1}, **(entry or {})}
    before = copy.deepcopy(entry)
    try:
        check_space(Space(yaml.safe_load(text)), algo, env_id, entry)
    finally:
        assert entry == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gama: {float: [0, 1]}", "'gama' = 0.0: Unknown key 'gama' of TD3. Did you mean 'gamma'"),
        ("gamma: {float: [0.5, 1.5]}", "'gamma' = 1.5: .* expected a finite number from 0 to 1."),
        ("learning_rate: {float: [0, 1]}", "'learning_rate' = 0.0: .* finite number above 0."),
        ("batch_size: {float: [1, 9.5]}", "'batch_size' = 9.5: .* expected a whole number."),
        ("gradient_steps: {int: [-1, 0]}", "'gradient_steps' = 0: .* 1 or more, or -1"),
        ("policy_kwargs.dropout: {float: [0, 1]}", "'policy_kwargs.dropout' = 0.0: Unknown key"),
        ("policy: {choice: [MlpPolicy, MlPolicy]}", "'policy' = 'MlPolicy': Unknown policy"),
        ("noise_std: {float: [0.1, 0.2]}", "'noise_std' = 0.1: noise_type is None and noise_std"),
        ("n_envs: {int: [0, 2]}", "'n_envs' = 0: n_envs is 0: expected "),
        ("env_kwargs.n_lookahed: {int: [1, 2]}", "'env_kwargs.n_lookahed' = 1: Unknown option"),
        (
            "env_wrapper.TemporalStretch.factor: {float: [0, 1]}",
            "'env_wrapper.TemporalStretch.factor' = 0.0: factor is 0.0: expected ",
        ),
        ("env_wrapper.Stretch.x: {float: [1, 2]}", "'env_wrapper.Stretch.x' = 1.0: .* has no 'St"),
        (
            "env_wrapper: {choice: {none: [], wrong: [no.such.Wrapper]}}",
            r"'env_wrapper' = \['no.such.Wrapper'\]: env_wrapper: 'no.such.Wrapper' cannot be imp",
        ),
    ],
)
def test_unknown_settings_and_impossible_values_are_named_before_anything_is_trained(text, message):
    with pytest.raises(ConfigError, match=f"^Search space: {message}"):
        check(text)


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "{gamma: {float: [0, 1]}, tau: {float: [0, 1]}, gradient_steps: {choice: [-1, 1]}}",
        "{train_freq: {choice: [1, [1, episode]]}}",
        "{noise_std: {float: [0, 0.2]}, noise_type: {choice: [normal, ornstein-uhlenbeck]}}",
        "{env_wrapper.FingeringDecay.start: {int: [0, 9]}, "
        "env_wrapper.FingeringDecay.n_steps: {int: [1, 9]}}",
        "{normalize: {choice: [true, false]}, n_envs: {int: [1, 4]}}",
    ],
)
def test_what_is_possible_passes_also_settings_that_only_go_together(text):
    check(text)


class Fussy(gym.Wrapper):
    """An environment that tells only at the first reset that it cannot work."""

    made = 0

    def __init__(self, env, mood=0):
        super().__init__(env)
        Fussy.made += 1
        self.mood = mood

    def reset(self, **kwargs):
        if self.mood < 0:
            raise RuntimeError("not today")
        return super().reset(**kwargs)


def test_one_environment_in_this_process_is_enough_and_its_own_words_are_passed_on():
    entry = {"env_wrapper": f"{__name__}.Fussy", "n_envs": 3, "vec_env": "subproc"}
    before = Fussy.made
    message = "^Search space: 'env_wrapper.Fussy.mood' = -1: RuntimeError: not today"
    with pytest.raises(ConfigError, match=message):  # not: a process ended
        check("env_wrapper.Fussy.mood: {int: [-1, 1]}", entry)
    assert Fussy.made - before == 3  # with all settings, with none, and with this one alone


@pytest.mark.filterwarnings("error")
def test_warnings_are_left_to_the_training():
    check("batch_size: {choice: [48, 64]}", {"n_steps": 64}, algo="ppo")


def test_an_entry_that_is_wrong_by_itself_is_not_blamed_on_the_space():
    with pytest.raises(ConfigError, match="^Unknown key 'gama' of TD3"):
        check("gamma: {float: [0, 1]}", {"gama": 0.9})
    with pytest.raises(ConfigError, match=r"^There is no MIDI file 'none\.mid'"):
        check("gamma: {float: [0.6, 0.9]}", {"env_kwargs": {"score": "none.mid"}})
