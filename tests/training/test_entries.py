"""Entries of YAML files: settings by their paths, and files that RL Zoo reads as we do."""

from __future__ import annotations

import argparse
import copy
import shlex
from pathlib import Path

import pytest
import yaml
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import PRESETS
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.training import load_config, load_entry
from sb3_piano.training.configuration.entries import (
    setting_at,
    train_commands,
    with_settings,
    write_entry,
    zoo_entry,
)
from sb3_piano.training.configuration.yaml_files import entry_config

tables = Tables(__file__)

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STRETCH = "sb3_piano.wrappers.TemporalStretch"
JUDGE = "sb3_piano.callbacks.F1Callback"
SCALE = "gymnasium.wrappers.RescaleAction"
ENTRY = {"n_timesteps": 100, "policy": "MlpPolicy"}


def test_settings_go_where_their_paths_lead():
    entry, settings = {**ENTRY, **tables["entry"]}, tables["settings"]
    before, layers = copy.deepcopy(entry), settings["policy_kwargs.net_arch"]
    result = with_settings(entry, settings)
    assert result == {**ENTRY, **tables["result"]}
    assert {name: setting_at(result, name) for name in settings} == settings
    result["policy_kwargs"]["net_arch"].append(1)  # nothing is shared
    assert (entry, layers) == (before, [8, 8])


def test_what_is_chosen_as_a_whole_can_be_changed_in_part():
    decay = "env_wrapper.FingeringDecay"
    settings = {
        "policy_kwargs.net_arch.pi": [1],
        "policy_kwargs": {"net_arch": {"pi": [2], "qf": [3]}},
        "env_wrapper.TemporalStretch.factor": 3,
        "env_wrapper": [SCALE, {STRETCH: {"factor": 1}}],
        f"{decay}.n_steps": 10,  # two arguments of a missing wrapper go to one
        f"{decay}.start": 0.5,
    }
    result = with_settings(ENTRY, settings)
    assert result["policy_kwargs"] == {"net_arch": {"pi": [1], "qf": [3]}}
    missing = {"sb3_piano.wrappers.FingeringDecay": {"n_steps": 10, "start": 0.5}}
    assert result["env_wrapper"] == [{SCALE: {}}, {STRETCH: {"factor": 3}}, missing]


@tables("wrappers, result")
def test_an_argument_goes_to_its_wrapper_and_an_own_wrapper_that_is_missing_outermost(
    wrappers, result
):
    entry = {**ENTRY, "env_wrapper": wrappers}
    before, name = copy.deepcopy(entry), "env_wrapper.TemporalStretch.factor"
    changed = with_settings(entry, {name: 2})
    assert changed["env_wrapper"] == result
    assert setting_at(changed, name) == 2
    assert entry == before


@tables("entry, name")
def test_of_what_an_entry_lacks_the_default_is_told(entry, name):
    assert setting_at(entry, name) is None
    assert setting_at(entry, name, 3) == 3


@tables("entry, name, message")
def test_a_path_that_leads_nowhere_is_refused_by_name(entry, name, message):
    with pytest.raises(ConfigError, match=f"^'{name}': {message}"):
        with_settings(entry, {name: 1})


# Files of entries, and the two commands that train with them.


def write_and_read(tmp_path, algo, env_id, entry, comment=()):
    """Return the entry in the file, after it was checked to mean the same to us."""
    file = tmp_path / "entry.yml"
    write_entry(file, algo, env_id, entry, comment)
    _, left_out = zoo_entry(algo, env_id, entry)
    ((_, written),) = yaml.safe_load(file.read_text()).items()
    again = entry_config(algo, env_id, {**written, **left_out})
    assert again == entry_config(algo, env_id, entry)
    if not left_out:
        assert load_config(algo, env_id, file) == again
    assert list(written) == [name for name in entry if name not in left_out]
    return written


@pytest.mark.parametrize("algo", PRESETS)
def test_presets_mean_the_same_when_written_changed_ones_too(algo, tmp_path):
    for name in read_yaml_mapping(PRESETS[algo]):
        env_id = ENV_ID if name == "default" else name
        entry = load_entry(algo, env_id)
        write_and_read(tmp_path, algo, env_id, entry)
        arch = {"policy_kwargs.net_arch": {"pi": [8], "qf": [8], "vf": [8]}}
        written = write_and_read(tmp_path, algo, env_id, with_settings(entry, arch))
        assert "torch.nn" not in str(written["policy_kwargs"])  # a name that RL Zoo has not


@tables("changes, expected")
def test_every_key_is_written_as_rl_zoo_wants_it(changes, expected):
    found, left_out = zoo_entry("sac", ENV_ID, {**ENTRY, **changes, "train_freq": (1, "episode")})
    assert {name: found[name] for name in changes if name in found} == expected
    assert left_out == {}
    assert found["train_freq"] == [1, "episode"]
    # RL Zoo has no default for the policy.
    assert zoo_entry("sac", ENV_ID, {"n_timesteps": 100})[0]["policy"] == "MlpPolicy"


def test_what_rl_zoo_does_not_know_is_left_out_named_and_an_option_of_ours(tmp_path):
    own = {"vec_env": "threads", "num_threads": 2, "device": "cpu", "seed": 7}
    written = write_and_read(tmp_path, "sac", ENV_ID, {**ENTRY, "n_envs": 2, **own})
    assert written == {**ENTRY, "n_envs": 2}
    file = tmp_path / "entry.yml"
    left_out = "no such key: vec_env: threads, num_threads: 2, device: cpu, seed: 7.\n"
    assert left_out in file.read_text()
    ours = train_commands("sac", ENV_ID, file, {**ENTRY, **own})["Train"]
    assert ours.endswith(f"--config {file} --vec-env threads --num-threads 2")


def test_rl_zoos_own_parser_reads_the_arguments_of_the_environment():
    from rl_zoo3.utils import StoreDict  # which takes long to be imported

    kwargs = {
        "score": 'it\'s a "study" of `rm` $HOME, C:\\x!.mid',
        "n_steps_lookahead": 2,
        "forearm_reward": False,
        "reward_weights": {"energy": 0.5, "fingering": 1},
    }
    entry = {**ENTRY, "env_kwargs": kwargs}
    commands = train_commands("sac", "RoboPianist-v0", Path("best.yml"), entry)
    parser = argparse.ArgumentParser()
    for option in ("--algo", "--env", "--gym-packages", "--conf-file"):
        parser.add_argument(option)
    parser.add_argument("--eval-env-kwargs", nargs="+", action=StoreDict)
    words = shlex.split(commands["Train in RL Zoo"])
    assert words[:3] == ["python", "-m", "rl_zoo3.train"]
    found = parser.parse_args(words[3:])
    assert found.eval_env_kwargs == kwargs
    assert (found.algo, found.env, found.gym_packages) == ("sac", "RoboPianist-v0", "sb3_piano")


def test_a_collection_of_pieces_has_no_command_in_rl_zoo():
    own = {"pieces": ["scale-*Major", "hanon-01"]}
    commands = train_commands("sac", "RoboPianist-v0", Path("best.yml"), {**ENTRY, **own})
    assert list(commands) == ["Train"]
    words = shlex.split(commands["Train"])
    assert words[4:] == ["--pieces", *own["pieces"], "--config", "best.yml"]


def test_whatever_is_in_a_comment_stays_there(tmp_path):
    comment = ["one", "a\nevil: true\r\u2028worse: 1\x85bad: 2"]
    write_and_read(tmp_path, "sac", ENV_ID, ENTRY, comment)
    assert (tmp_path / "entry.yml").read_text().startswith("# one\n# a evil: true")
