"""The search spaces that come with the package fit algorithms, environments and presets."""

from __future__ import annotations

import pytest

from sb3_piano.envs import DEBUG_IDS, DEFAULT_REWARD_WEIGHTS
from sb3_piano.hyperparams import PRESETS
from sb3_piano.training import ALGORITHMS, load_entry
from sb3_piano.tuning.search_space.built_in import SPACES
from sb3_piano.tuning.search_space.defaults import with_defaults

ENV_ID = DEBUG_IDS[1]


def algorithm_of(name: str) -> str:
    return name if name in ALGORITHMS else "sac"


def test_there_is_one_for_each_algorithm_of_the_presets_and_two_for_any():
    assert PRESETS.keys() | {"env", "reward"} <= SPACES.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", SPACES)
def test_every_setting_and_range_is_accepted_where_it_enters(name):
    algo = algorithm_of(name)
    SPACES[name].check(algo, ENV_ID, load_entry(algo, ENV_ID))


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
    assert space.params_of(space.apply(entry, settings)) == full


@pytest.mark.parametrize("name", ["td3", "sac", "tqc", "ddpg"])
def test_the_published_settings_lie_inside(name):
    entry = load_entry(name, "RoboPianist-v0")
    space = SPACES[name]
    settings = space.settings(space.params_of(entry))
    found = {"gamma", "learning_rate", "batch_size", "tau", "policy_kwargs.net_arch"}
    assert found <= settings.keys()
    assert (settings["gamma"], settings["tau"]) == (0.8, 0.005)
    assert settings["policy_kwargs.net_arch"] == [256, 256, 256]


@pytest.mark.parametrize("name", sorted(set(SPACES) - {"env", "reward"}))
def test_the_horizon_is_searched_around_that_of_robopianist(name):
    gamma = SPACES[name]["gamma"]
    assert {gamma.stored(value) for value in (0.8, 0.88)} == {0.2, 0.12}
    assert gamma.stored(0.99) is None


def test_batches_of_ppo_are_all_full():
    steps, batches = (SPACES["ppo"][name].extremes() for name in ("n_steps", "batch_size"))
    assert all(n % size == 0 for n in steps for size in batches)


def test_rewards_are_searched_around_their_defaults_but_for_the_unit():
    prefix = "env_kwargs.reward_weights."
    terms = {name.removeprefix(prefix) for name in SPACES["reward"]}
    assert terms == DEFAULT_REWARD_WEIGHTS.keys() - {"key_press"}
    for term in terms:
        low, high = SPACES["reward"][f"{prefix}{term}"].extremes()
        assert low < DEFAULT_REWARD_WEIGHTS[term] < high


def test_env_settings_change_nothing_about_the_music():
    names = {name.removeprefix("env_kwargs.") for name in SPACES["env"]}
    assert names == {"n_steps_lookahead", "observation"}
