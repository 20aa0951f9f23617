"""Settings in an RL Zoo entry by their paths, whether it is written in YAML or as text."""

from __future__ import annotations

import copy

import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.training.configuration.yaml_files import entry_config
from sb3_piano.tuning.space import MISSING, setting_at, with_defaults, with_settings

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STRETCH = "sb3_piano.wrappers.TemporalStretch"
SCALE = "gymnasium.wrappers.RescaleAction"
ENTRY = {"n_timesteps": 100, "policy": "MlpPolicy"}


def test_settings_go_where_their_paths_lead():
    entry = {
        **ENTRY,
        "gamma": 0.8,
        "policy_kwargs": {"net_arch": [64], "log_std_init": -2},
        "env_kwargs": "dict(physics='fast', reward_weights=dict(energy=0.01))",
    }
    before, layers = copy.deepcopy(entry), [8, 8]
    settings = {
        "gamma": 0.9,
        "tau": 0.01,
        "policy_kwargs.net_arch": layers,
        "env_kwargs.n_steps_lookahead": 3,
        "env_kwargs.reward_weights.fingering": 0.5,
        "replay_buffer_kwargs.a.b": 1,
    }
    result = with_settings(entry, settings)
    assert result == {
        **ENTRY,
        "gamma": 0.9,
        "tau": 0.01,
        "policy_kwargs": {"net_arch": [8, 8], "log_std_init": -2},
        "env_kwargs": {
            "physics": "fast",
            "n_steps_lookahead": 3,
            "reward_weights": {"energy": 0.01, "fingering": 0.5},
        },
        "replay_buffer_kwargs": {"a": {"b": 1}},
    }
    assert {name: setting_at(result, name) for name in settings} == settings
    result["policy_kwargs"]["net_arch"].append(1)  # nothing is shared
    assert (entry, layers) == (before, [8, 8])


def test_what_is_chosen_as_a_whole_can_be_changed_in_part():
    settings = {
        "policy_kwargs.net_arch.pi": [1],
        "policy_kwargs": {"net_arch": {"pi": [2], "qf": [3]}},
        "env_wrapper.TemporalStretch.factor": 3,
        "env_wrapper": [SCALE, {STRETCH: {"factor": 1}}],
    }
    result = with_settings(ENTRY, settings)
    assert result["policy_kwargs"] == {"net_arch": {"pi": [1], "qf": [3]}}
    assert result["env_wrapper"] == [{SCALE: {}}, {STRETCH: {"factor": 3}}]


@pytest.mark.parametrize(
    ("wrappers", "result"),
    [
        (None, [{STRETCH: {"factor": 2}}]),
        (STRETCH, [{STRETCH: {"factor": 2}}]),
        ({STRETCH: {"factor": 1}}, [{STRETCH: {"factor": 2}}]),
        (SCALE, [{SCALE: {}}, {STRETCH: {"factor": 2}}]),
        (
            [{STRETCH: {"factor": 1}}, {SCALE: {"x": 1}}],
            [{STRETCH: {"factor": 2}}, {SCALE: {"x": 1}}],
        ),
    ],
)
def test_an_argument_goes_to_its_wrapper_and_an_own_wrapper_that_is_missing_outermost(
    wrappers, result
):
    entry = {**ENTRY, "env_wrapper": wrappers}
    before, name = copy.deepcopy(entry), "env_wrapper.TemporalStretch.factor"
    changed = with_settings(entry, {name: 2})
    assert changed["env_wrapper"] == result
    assert setting_at(changed, name) == 2
    assert entry == before


def test_two_arguments_of_a_missing_wrapper_go_to_one():
    decay = "env_wrapper.FingeringDecay"
    result = with_settings(ENTRY, {f"{decay}.n_steps": 10, f"{decay}.start": 0.5})
    kwargs = {"n_steps": 10, "start": 0.5}
    assert result["env_wrapper"] == [{"sb3_piano.wrappers.FingeringDecay": kwargs}]


@pytest.mark.parametrize(
    ("entry", "name"),
    [
        ({}, "gamma"),
        ({"policy_kwargs": "broken("}, "policy_kwargs.net_arch"),
        ({"env_kwargs": {"reward_weights": 3}}, "env_kwargs.reward_weights.energy"),
        ({"env_wrapper": [SCALE, {STRETCH: {}}]}, "env_wrapper.TemporalStretch.factor"),
        ({}, "env_wrapper.TemporalStretch.factor"),
    ],
)
def test_what_an_entry_lacks_is_missing(entry, name):
    assert setting_at(entry, name) is MISSING


@pytest.mark.parametrize(
    ("entry", "name", "message"),
    [
        ({}, "env_wrapper.TemporalStrech.factor", "env_wrapper has no 'TemporalStrech'. Did you"),
        (
            {"env_wrapper": SCALE},
            "env_wrapper.RescaleActoin.low",
            "env_wrapper has no 'RescaleActoin'. Did you mean 'RescaleAction'",
        ),
        (
            {"env_wrapper": [STRETCH, STRETCH]},
            "env_wrapper.TemporalStretch.factor",
            "env_wrapper has TemporalStretch 2 times: expected it once",
        ),
        ({"env_wrapper": [{}]}, "env_wrapper.A.b", r".*\{\} is no entry for env_wrapper: expected"),
        ({"gamma": 0.9}, "gamma.x", "gamma is 0.9: expected a mapping"),
        ({"policy_kwargs": "dict(a=[1])"}, "policy_kwargs.a.b", "policy_kwargs.a is .*: expec"),
        ({"policy_kwargs": "dict(a=)"}, "policy_kwargs.a", "'dict\\(a=\\)' cannot be read"),
    ],
)
def test_a_path_that_leads_nowhere_is_refused_by_name(entry, name, message):
    with pytest.raises(ConfigError, match=f"^Search space: '{name}': {message}"):
        with_settings(entry, {name: 1})


@pytest.mark.parametrize(
    "policy_kwargs",
    [
        "dict(net_arch=[64, 64], activation_fn=nn.ReLU, n_critics=1)",
        {"net_arch": [64, 64], "activation_fn": "nn.ReLU", "n_critics": 1},
    ],
)
def test_text_that_the_zoo_evaluates_may_be_changed_inside(policy_kwargs):
    settings = {"policy_kwargs.net_arch": {"pi": [8], "qf": [16, 16]}}
    entry = with_settings({**ENTRY, "policy_kwargs": policy_kwargs}, settings)
    assert entry_config("sac", ENV_ID, entry).algorithm_kwargs["policy_kwargs"] == {
        "net_arch": {"pi": [8], "qf": [16, 16]},
        "activation_fn": "torch.nn.ReLU",
        "n_critics": 1,
    }


def test_with_its_defaults_an_entry_has_what_it_does_not_say():
    entry = {"n_timesteps": 1, "gamma": 0.9, "env_kwargs": {"reward_weights": {"energy": 0.5}}}
    before = copy.deepcopy(entry)
    full = with_defaults("sac", ENV_ID, entry)
    found = {
        "tau": 0.005,
        "gamma": 0.9,
        "policy": "MlpPolicy",
        "env_kwargs.n_steps_lookahead": 10,
        "env_kwargs.reward_weights.energy": 0.5,
        "env_kwargs.reward_weights.fingering": 1.0,
    }
    assert {name: setting_at(full, name) for name in found} == found
    assert entry == before
    assert "env_kwargs" not in with_defaults("sac", "Pendulum-v1", {"n_timesteps": 1})
