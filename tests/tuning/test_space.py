"""Search spaces: what trials get, what the store holds, what YAML says, and what is refused."""

from __future__ import annotations

import copy
import itertools
import json
import math
import pickle
from pathlib import Path

import gymnasium as gym
import optuna
import pytest
import yaml
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
from yaml_rows import Tables

from sb3_piano.envs import DEBUG_IDS, DEFAULT_REWARD_WEIGHTS
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import PRESETS
from sb3_piano.training import load_entry
from sb3_piano.training.configuration.entries import with_settings
from sb3_piano.training.configuration.names import ALGORITHMS
from sb3_piano.tuning.space import (
    SPACES,
    Parameter,
    Space,
    check_space,
    load_space,
    parse_parameter,
)

tables = Tables(__file__)

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STRETCH = "sb3_piano.wrappers.TemporalStretch"
ENTRY = {"n_timesteps": 100, "policy": "MlpPolicy"}

# Parameters.


def parameter(value) -> Parameter:
    return parse_parameter("x", value)


def suggested(of, count=5):
    """Return values that trials got, and the trials."""
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    trials = [study.ask() for _ in range(count)]
    return [of.suggest(trial, "x") for trial in trials], study.trials


@tables("form", ids=str)
def test_yaml_and_the_store_give_parameters_and_values_back(form):
    of, text = parameter(form), yaml.safe_dump(form, sort_keys=False)
    assert of.form == form
    for same in (json.loads(json.dumps(form)), yaml.safe_load(text), of):
        assert parameter(same) == of
    values, trials = suggested(of)
    for value, trial in zip(values, trials, strict=True):
        (name,) = trial.params
        assert name == of.stored_name("x")
        assert of.value(trial.params[name]) == value
        assert trial.distributions[name] == of.distribution
    for value in [] if of.choices else [*values, *of.extremes()]:
        assert of.value(of.stored(value)) == pytest.approx(value, rel=1e-9)


def test_optunas_distributions_are_taken_as_they_are():
    floats = FloatDistribution(1e-4, 1e-2, log=True), FloatDistribution(0, 1, step=0.25)
    for distribution in (*floats, IntDistribution(1, 9, step=2), CategoricalDistribution("ab")):
        found = parameter(distribution)
        assert found.distribution == distribution
        assert parameter(found.form) == found


def test_a_discount_is_searched_evenly_in_the_logarithm_of_its_distance_from_1():
    values, _ = suggested(parameter({"discount": [0.0, 0.99]}), count=400)
    assert all(0 <= value <= 0.99 for value in values)
    below = sum(value < 0.9 for value in values)  # half of the way from 1 to 0.01
    assert 150 < below < 250
    gamma = parameter({"discount": [0.6, 0.97]})
    assert gamma.stored_name("gamma") == "1 - gamma"
    assert gamma.distribution == FloatDistribution(0.03, 0.4, log=True)
    assert (gamma.stored(0.8), gamma.value(0.2)) == (0.2, 0.8)  # exactly: 1 - 0.8 is not 0.2
    low, high = 0.1234567890123456, 0.6543210987654321
    gamma = parameter({"discount": [low, high]})  # rounding leads beyond neither end
    assert gamma.value(gamma.distribution.low) == high
    assert gamma.value(math.nextafter(gamma.distribution.high, 1)) == low


@tables("form, value, stored")
def test_a_range_stores_what_it_holds_however_that_is_written(form, value, stored):
    assert parameter(form).stored(value) == stored


def test_neither_what_a_trial_gets_nor_what_it_was_made_of_changes_a_choice():
    layers = [64]
    choice = parameter({"choice": [layers, [128]]})
    layers.append(64)
    choice.value("[64]").append(1)
    choice.extremes()[0].append(1)
    assert choice == parameter({"choice": [[64], [128]]})


@tables("value, message")
def test_what_cannot_be_searched_is_refused_by_name(value, message):
    with pytest.raises(ConfigError, match=f"^Search space: 'tau': .*{message}"):
        parse_parameter("tau", value)


# Spaces.

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
    again = Space(json.loads(json.dumps(SPACE.to_mapping())))
    assert again == SPACE == pickle.loads(pickle.dumps(SPACE)) == copy.deepcopy(SPACE)
    assert again.distributions == SPACE.distributions
    assert SPACE.settings({"batch_size": 64, "other": 1}) == {"batch_size": 64}


@tables("given, message")
def test_a_space_that_makes_no_sense_is_refused(given, message):
    with pytest.raises(ConfigError, match=message):
        Space(given)


@tables("entry")
def test_an_enqueued_trial_has_the_settings_of_the_entry(entry):
    params = SPACE.params_of("sac", ENV_ID, with_settings({**ENTRY, **entry}, SETTINGS))
    assert params["1 - gamma"] == 0.2
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    study.enqueue_trial(params)
    assert SPACE.suggest(study.ask()) == SETTINGS


@tables("entry, params")
def test_defaults_count_and_what_lies_outside_is_left_out(entry, params):
    params = {"env_kwargs.n_steps_lookahead" if k == "n" else k: v for k, v in params.items()}
    assert SPACE.params_of("sac", ENV_ID, {**ENTRY, **entry}) == params


def test_the_weight_of_a_reward_term_of_ones_own_is_searched_from_its_default():
    name = "env_kwargs.reward_weights.still"
    space = Space({name: {"float": [0.1, 2.0]}})
    entry = {**ENTRY, "env_kwargs": {"reward_terms": {"still": "own_terms.still"}}}
    assert space.params_of("sac", ENV_ID, entry) == {name: 0.25}
    assert space.params_of("sac", ENV_ID, with_settings(entry, {name: 0.5})) == {name: 0.5}
    check_space(space, "sac", ENV_ID, entry)
    with pytest.raises(ConfigError, match="Unknown reward term 'still'"):
        check_space(space, "sac", ENV_ID, ENTRY)


# Spaces by name and from files.


def test_a_space_comes_from_names_and_files_of_which_the_last_one_counts(tmp_path):
    first, second = tmp_path / "a.yml", tmp_path / "without_ending"
    first.write_text("gamma: {float: [0, 0.5]}\nn_steps: {int: [1, 3]}\n")
    second.write_text("n_steps: {choice: [1, 2]}\n")
    own = {"gamma": {"float": [0, 0.5]}, "n_steps": {"choice": [1, 2]}}
    assert load_space(["sac", first, str(second)], "sac") == Space({**SPACES["sac"], **own})
    assert load_space([first, "sac"], "a2c")["gamma"] == SPACES["sac"]["gamma"]
    assert load_space([], "tqc") == SPACES["tqc"]


@tables("text, sources, message")
def test_what_holds_no_space_is_named(tmp_path, monkeypatch, text, sources, message):
    monkeypatch.chdir(tmp_path)
    if text is not None:
        Path("a.yml").write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_space(sources, "a2c")


# The spaces that come with the package fit algorithms, environments and presets.


def algorithm_of(name: str) -> str:
    return name if name in ALGORITHMS else "sac"


@pytest.mark.slow
@pytest.mark.parametrize("name", SPACES)
def test_every_setting_and_range_is_accepted_where_it_enters(name):
    algo = algorithm_of(name)
    check_space(SPACES[name], algo, DEBUG_IDS[1], load_entry(algo, DEBUG_IDS[1]))


@pytest.mark.parametrize(
    ("name", "env_id"),
    [
        *itertools.product(SPACES, (DEBUG_IDS[0], DEBUG_IDS[-1])),
        *((name, "RoboPianist-v0") for name in ("td3", "sac", "tqc", "ddpg")),
    ],
)
def test_the_settings_of_the_presets_lie_inside(name, env_id):
    algo, space = algorithm_of(name), SPACES[name]
    entry = load_entry(algo, env_id)
    params = space.params_of(algo, env_id, entry)
    assert {*PRESETS, "env", "reward"} == SPACES.keys()
    assert params.keys() == space.distributions.keys()
    assert space.params_of(algo, env_id, with_settings(entry, space.settings(params))) == params


def test_batches_of_ppo_are_full_and_rewards_searched_around_their_defaults_but_for_the_unit():
    steps, batches = (SPACES["ppo"][name].extremes() for name in ("n_steps", "batch_size"))
    assert all(n % size == 0 for n in steps for size in batches)
    prefix = "env_kwargs.reward_weights."
    terms = {name.removeprefix(prefix) for name in SPACES["reward"]}
    assert {"fingering"} <= terms <= DEFAULT_REWARD_WEIGHTS.keys() - {"key_press"}
    for term in terms:
        low, high = SPACES["reward"][f"{prefix}{term}"].extremes()
        assert low == pytest.approx(DEFAULT_REWARD_WEIGHTS[term] / 10)
        assert high > DEFAULT_REWARD_WEIGHTS[term]


# Spaces are tried out where their settings enter, before anything is trained.


def check(text, entry=None, algo="td3"):
    entry = {**ENTRY, "env_kwargs": {"n_steps_lookahead": 1}, **(entry or {})}
    before = copy.deepcopy(entry)
    try:
        check_space(Space(yaml.safe_load(text)), algo, ENV_ID, entry)
    finally:
        assert entry == before


@pytest.mark.slow
@tables("text, message")
def test_unknown_settings_and_impossible_values_are_told_before_anything_is_trained(text, message):
    with pytest.raises(ConfigError, match=f"^Search space, with {{{message}"):
        check(text)


@pytest.mark.slow
@tables("text")
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
    message = "'env_wrapper.Fussy.mood': -1}: RuntimeError: not today"
    with pytest.raises(ConfigError, match=message):  # not: a process ended
        check("env_wrapper.Fussy.mood: {int: [-1, 1]}", entry)
    assert Fussy.made - before == 2  # with the entry alone, and with the lower end


@pytest.mark.filterwarnings("error")
def test_warnings_are_left_to_the_training():
    check("batch_size: {choice: [48, 64]}", {"n_steps": 64}, algo="ppo")


def test_an_entry_that_is_wrong_by_itself_is_not_blamed_on_the_space():
    with pytest.raises(ConfigError, match="^Unknown key 'gama' of TD3"):
        check("gamma: {float: [0, 1]}", {"gama": 0.9})
    with pytest.raises(ConfigError, match=r"^There is no MIDI file 'none\.mid'"):
        check("gamma: {float: [0.6, 0.9]}", {"env_kwargs": {"score": "none.mid"}})
