"""Entries of YAML files: settings by their paths, and files that RL Zoo reads as we do."""

from __future__ import annotations

import copy

import pytest
import yaml

from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import PRESETS
from sb3_piano.training import load_config, load_entry
from sb3_piano.training.configuration.entries import setting_at, with_settings, write_entry
from sb3_piano.training.configuration.yaml_files import entry_config

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
def test_of_what_an_entry_lacks_the_default_is_told(entry, name):
    assert setting_at(entry, name) is None
    assert setting_at(entry, name, 3) == 3


@pytest.mark.parametrize(
    ("entry", "name", "message"),
    [
        ({"env_wrapper": [STRETCH, STRETCH]}, "env_wrapper.TemporalStretch.factor", "env_wrapper"),
        ({"env_wrapper": [{}]}, "env_wrapper.A.b", r".*\{\} is no entry for env_wrapper: expected"),
        ({"gamma": 0.9}, "gamma.x", "gamma is 0.9: expected a mapping"),
        ({"policy_kwargs": "dict(a=[1])"}, "policy_kwargs.a.b", "a is .*: expected"),
        ({"policy_kwargs": "dict(a=)"}, "policy_kwargs.a", "'dict\\(a=\\)' cannot be read"),
    ],
)
def test_a_path_that_leads_nowhere_is_refused_by_name(entry, name, message):
    with pytest.raises(ConfigError, match=f"^'{name}': {message}"):
        with_settings(entry, {name: 1})


# Files of entries.


def write_and_read(tmp_path, algo, env_id, entry, comment=()):
    """Return the entry in the file, after it was checked to mean the same to us."""
    file = tmp_path / "entry.yml"
    write_entry(file, env_id, entry, comment)
    assert load_config(algo, env_id, file) == entry_config(algo, env_id, entry)
    ((_, written),) = yaml.safe_load(file.read_text()).items()
    assert list(written) == list(entry)
    return written


@pytest.mark.parametrize("algo", PRESETS)
def test_presets_are_written_as_rl_zoo_reads_them_changed_ones_too(algo, tmp_path):
    entry = load_entry(algo, ENV_ID)
    assert write_and_read(tmp_path, algo, ENV_ID, entry) == entry
    arch = {"policy_kwargs.net_arch": {"pi": [8], "qf": [8], "vf": [8]}}
    written = write_and_read(tmp_path, algo, ENV_ID, with_settings(entry, arch))
    assert "torch.nn" not in str(written["policy_kwargs"])  # text of a class that RL Zoo has not


@pytest.mark.parametrize(
    ("kwargs", "text"),
    [
        ("dict(n_critics=1, activation_fn=nn.ReLU)", "'n_critics': 1, 'activation_fn': nn.ReLU"),
        (
            {"optimizer_class": "torch.optim.AdamW"},
            "'optimizer_class': importlib.import_module('torch.optim').AdamW",
        ),
        ({"n_critics": 1}, None),
    ],
)
def test_a_class_in_what_was_changed_is_text_that_rl_zoo_evaluates(kwargs, text, tmp_path):
    entry = with_settings({**ENTRY, "policy_kwargs": kwargs}, {"policy_kwargs.net_arch": [8]})
    found = write_and_read(tmp_path, "sac", ENV_ID, entry)["policy_kwargs"]
    assert found == (f"{{{text}, 'net_arch': [8]}}" if text else {**kwargs, "net_arch": [8]})


def test_whatever_is_in_a_comment_stays_there(tmp_path):
    comment = ["one", "a\nevil: true\r\u2028worse: 1\x85bad: 2"]
    write_and_read(tmp_path, "sac", ENV_ID, ENTRY, comment)
    assert (tmp_path / "entry.yml").read_text().startswith("# one\n# a evil: true")
