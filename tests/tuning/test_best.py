"""The file of the best settings: what it holds, and that ours and stock RL Zoo train alike."""

from __future__ import annotations

import argparse
import csv
import shlex

import pytest
import torch
import yaml
from finished_study import (
    ENTRY,
    ENV_ID,
    complete,
    fail,
    finished_study,
    interrupt,
    new_study,
    prune,
    study_config,
)
from fresh_python import run_python
from rl_zoo3.utils import StoreDict
from stable_baselines3 import SAC

from sb3_piano.cli import main
from sb3_piano.hyperparams import PRESETS
from sb3_piano.training import load_config
from sb3_piano.training.configuration.yaml_files import entry_config, read_yaml_mapping
from sb3_piano.tuning.best import (
    best_entry,
    write_best,
    zoo_entry,
)
from sb3_piano.tuning.study import StudyFolder


@pytest.fixture
def folder(tmp_path):
    return StudyFolder(tmp_path)


def commands_in(file):
    """Return the command lines in the head of a file."""
    lines = [line.removeprefix("# ").strip() for line in file.read_text().splitlines()]
    return [line for line in lines if line.startswith(("sb3-piano train", "python -m rl_zoo3"))]


# What the file holds.


def test_the_file_has_one_entry_with_the_best_settings_in_the_entrys_order(folder):
    config = study_config()
    study = finished_study(config)
    file = write_best(study, config, folder)
    assert file == folder.best_file
    content = yaml.safe_load(file.read_text())
    assert list(content) == [ENV_ID]
    assert list(content[ENV_ID]) == list(ENTRY)
    best = config.space.settings(study.best_trial.params)
    assert content[ENV_ID]["learning_rate"] == best["learning_rate"] != 0.001
    assert content[ENV_ID]["gamma"] == best["gamma"]
    assert content[ENV_ID]["policy_kwargs"] == {"net_arch": best["policy_kwargs.net_arch"]}
    found = load_config("sac", ENV_ID, file)
    assert found == entry_config("sac", ENV_ID, best_entry(study, config))
    assert f"    net_arch: {best['policy_kwargs.net_arch']}\n" in file.read_text()
    assert not list(folder.path.glob("*.partial"))


def test_the_head_says_where_the_settings_come_from(folder):
    config = study_config(
        seeds=(3, 4), metric="onset_f1", objective="best", eval_episodes=2, minutes=2.5
    )
    study = new_study("etudes")
    for value in (0.125, 0.375, 0.25):
        complete(study, config, value)
    head = write_best(study, config, folder).read_text().split(f"\n{ENV_ID}")[0]
    head = " ".join(head.replace("#", "").split())
    for text in (
        *("study 'etudes': trial 1 of 3, with a value of 0.375", "2 episodes from seed 1000"),
        *(
            "the highest onset F1 of a training's evaluations",
            "mean over 2 trainings",
            "stable_baselines3 2.",
        ),
        *("1,000 steps from each of the seeds 3, 4, 2.5 minutes at most", "sb3_piano 0."),
        "--steps N, in RL Zoo -n N",
    ):
        assert text in head
    assert "Left out" not in head


@pytest.mark.parametrize("kinds", [(), (fail, prune, interrupt)])
def test_without_a_complete_trial_there_is_no_file(kinds, folder):
    config, study = study_config(), new_study()
    for kind in kinds:
        kind(study, config, *([0.3] if kind is prune else []))
    assert best_entry(study, config) is None
    assert write_best(study, config, folder) is None
    assert not folder.best_file.exists()


def test_names_of_several_lines_stay_in_the_comment(tmp_path):
    lines = "a\nevil: true\r\u2028worse: 1\x85bad: 2"
    config, study = study_config(), new_study(lines)
    complete(study, config, 0.5)
    folder = StudyFolder(tmp_path / lines)
    folder.path.mkdir()
    assert list(yaml.safe_load(write_best(study, config, folder).read_text())) == [ENV_ID]


# The commands in it.


def zoo_arguments(command):
    """Return how RL Zoo's own parser of mappings reads a command line."""
    parser = argparse.ArgumentParser()
    for option in ("--algo", "--env", "--gym-packages", "--conf-file", "--seed"):
        parser.add_argument(option)
    parser.add_argument("--eval-env-kwargs", nargs="+", action=StoreDict)
    words = shlex.split(command)
    assert words[:3] == ["python", "-m", "rl_zoo3.train"]
    return parser.parse_args(words[3:])


def test_the_zoos_parser_reads_the_arguments_of_the_environment(folder):
    kwargs = {
        "score": 'it\'s a "study" of `rm` $HOME, C:\\x!.mid',
        "n_steps_lookahead": 2,
        "forearm_reward": False,
        "reward_weights": {"energy": 0.5, "fingering": 1},
        "physics": "fast",
    }
    config = study_config({**ENTRY, "env_kwargs": kwargs}, env_id="RoboPianist-v0")
    study = new_study()
    complete(study, config, 0.5)
    found = zoo_arguments(commands_in(write_best(study, config, folder))[1])
    assert found.eval_env_kwargs == kwargs
    assert (found.algo, found.env, found.gym_packages) == ("sac", "RoboPianist-v0", "sb3_piano")


def test_a_module_that_registers_the_environment_is_named_to_both(folder, tmp_path, monkeypatch):
    (tmp_path / "registers_anew.py").write_text(
        "import copy, gymnasium\n"
        f"gymnasium.registry[{ENV_ID!r}] = copy.copy(gymnasium.registry[{ENV_ID!r}])\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    config, study = study_config(env_id=f"registers_anew:{ENV_ID}"), new_study()
    complete(study, config, 0.5)
    file = write_best(study, config, folder)
    assert list(yaml.safe_load(file.read_text())) == [ENV_ID]
    ours, theirs = commands_in(file)
    assert f"--env registers_anew:{ENV_ID} " in ours
    found = zoo_arguments(theirs)
    assert (found.env, found.gym_packages) == (ENV_ID, "registers_anew")


def test_what_the_zoo_does_not_know_is_left_out_and_said(folder):
    entry = {**ENTRY, "vec_env": "threads", "n_envs": 2, "device": "cpu", "verbose": 1, "seed": 7}
    config, study = study_config(entry), new_study()
    complete(study, config, 0.5)
    file = write_best(study, config, folder)
    found = yaml.safe_load(file.read_text())[ENV_ID]
    assert set(found) == {*ENTRY, "n_envs"}
    head = " ".join(file.read_text().replace("#", "").split())
    assert "no such key: vec_env: threads, device: cpu, verbose: 1, seed: 7." in head
    assert "--vec-env threads" in commands_in(file)[0]


def test_pieces_and_how_torch_computes_are_options_of_our_command(folder):
    own = {"pieces": ["scale-*Major", "hanon-01"], "num_threads": 2, "matmul_precision": "high"}
    config = study_config({**ENTRY, **own}, env_id="RoboPianist-v0")
    study = new_study()
    complete(study, config, 0.5)
    file = write_best(study, config, folder)
    assert set(yaml.safe_load(file.read_text())["RoboPianist-v0"]) == set(ENTRY)
    words = shlex.split(commands_in(file)[0])
    assert words[:7] == ["sb3-piano", "train", "--algo", "sac", "--pieces", *own["pieces"]]
    assert words[-4:] == ["--num-threads", "2", "--matmul-precision", "high"]
    # RL Zoo would train on the piece that the environment has by itself
    assert len(commands_in(file)) == 1
    assert "no command for RL Zoo, which cannot be told what pieces" in file.read_text()


# Each key, in a form that the zoo takes.


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"learning_rate": "1e-4"}, {"learning_rate": 0.0001}),
        ({"learning_rate": "lin_3e-4"}, {"learning_rate": "lin_3e-4"}),
        ({"env_kwargs": "dict(physics='fast')"}, {"env_kwargs": {"physics": "fast"}}),
        (
            {"policy_kwargs": "dict(net_arch=[8], activation_fn=nn.Tanh)"},
            {"policy_kwargs": "{'net_arch': [8], 'activation_fn': nn.Tanh}"},
        ),
        (
            {"policy_kwargs": {"net_arch": {"pi": [8], "qf": [16]}}},
            {"policy_kwargs": {"net_arch": {"pi": [8], "qf": [16]}}},
        ),
        (
            {"policy_kwargs": {"optimizer_class": "torch.optim.AdamW"}},
            {"policy_kwargs": "{'optimizer_class': importlib.import_module('torch.optim').AdamW}"},
        ),
        (
            {"replay_buffer_class": "sb3_piano.buffers.CompactReplayBuffer"},
            {"replay_buffer_class": ENTRY["replay_buffer_class"]},
        ),
        (
            {"monitor_kwargs": {"info_keywords": ["f1"], "allow_early_resets": False}},
            {"monitor_kwargs": "{'info_keywords': ('f1',), 'allow_early_resets': False}"},
        ),
        ({"monitor_kwargs": {}}, {"monitor_kwargs": {}}),
        ({"train_freq": (1, "episode")}, {"train_freq": [1, "episode"]}),
        (
            {"callback": {"sb3_piano.callbacks.F1Callback": None}},
            {"callback": ["sb3_piano.callbacks.F1Callback"]},
        ),
        ({"env_wrapper": None}, {"env_wrapper": []}),
        ({"noise_type": None, "noise_std": None}, {}),
        ({"noise_type": "normal", "noise_std": "0.1"}, {"noise_type": "normal", "noise_std": 0.1}),
        ({"normalize": "dict(norm_obs=False)"}, {"normalize": {"norm_obs": False}}),
    ],
)  # fmt: skip
def test_every_key_is_written_as_the_zoo_wants_it(changes, expected):
    found, left_out = zoo_entry("sac", ENV_ID, {**ENTRY, **changes})
    assert {name: found[name] for name in changes if name in found} == expected
    assert left_out == {}


def test_the_policy_has_no_default_in_the_zoo():
    entry = {name: value for name, value in ENTRY.items() if name != "policy"}
    assert zoo_entry("sac", ENV_ID, entry)[0]["policy"] == "MlpPolicy"


@pytest.mark.slow
@pytest.mark.parametrize("algo", PRESETS)
def test_the_entries_of_all_presets_mean_the_same_afterwards(algo):
    entries = read_yaml_mapping(PRESETS[algo])
    for name, entry in entries.items():
        env_id = ENV_ID if name == "default" else name
        found, left_out = zoo_entry(algo, env_id, entry)
        again = yaml.safe_load(yaml.safe_dump(found))
        assert entry_config(algo, env_id, {**again, **left_out}) == entry_config(
            algo, env_id, entry
        )
        assert list(found) == [key for key in entry if key not in left_out]


# Both train with it, to the same digit.


def train_by_both_commands(file, tmp_path):
    """Run both commands as they stand in a file; return the folders of the two runs."""
    ours, theirs = map(shlex.split, commands_in(file))
    assert ours[0] == "sb3-piano"
    assert main([*ours[1:], "--no-progress", "--run", str(tmp_path / "ours")]) == 0
    assert theirs[0] == "python"
    done = run_python([*theirs[1:], "--log-folder", str(tmp_path / "zoo")], tmp_path)
    assert done.returncode == 0, done.stderr
    (zoo_run,) = (tmp_path / "zoo").glob("*/*_1")
    return tmp_path / "ours", zoo_run


def episodes_in(folder):
    """Return what Monitor wrote of each episode, without the time, by file."""
    files = sorted(folder.glob("*.monitor.csv"))
    rows = [list(csv.DictReader(file.read_text().splitlines()[1:])) for file in files]
    return [[{**row, "t": None} for row in of_file] for of_file in rows]


@pytest.mark.slow
def test_sac_has_the_same_first_500_steps_in_ours_and_in_the_stock_zoo(folder, tmp_path):
    judging = {"sb3_piano.callbacks.F1Callback": {"eval_freq": 450}}
    config = study_config({**ENTRY, "n_timesteps": 500, "callback": [judging]})
    study = new_study()
    complete(study, config, 0.4)
    complete(study, config, 0.5)
    file = write_best(study, config, folder)
    ours, zoo_run = train_by_both_commands(file, tmp_path)
    # But for rounding: our updates leave out what changes nothing.
    (episodes,), (expected,) = episodes_in(ours / "monitor"), episodes_in(zoo_run)
    for found, row in zip(episodes, expected, strict=True):
        assert found.keys() == row.keys()
        numbers = [name for name, text in row.items() if text is not None]
        for name in numbers:
            assert float(found[name]) == pytest.approx(float(row[name]), rel=1e-3), name
    assert len(episodes) >= 3
    assert len({row["r"] for row in episodes}) == len(episodes)  # learned something, or explored
    trained, theirs = (
        SAC.load(file, device="cpu") for file in (ours / "model.zip", zoo_run / f"{ENV_ID}.zip")
    )
    for name, weights in theirs.policy.state_dict().items():
        torch.testing.assert_close(
            trained.policy.state_dict()[name], weights, rtol=1e-3, atol=1e-3, msg=name
        )
    best = config.space.settings(study.best_trial.params)
    assert (trained.gamma, trained.batch_size) == (best["gamma"], best["batch_size"])
    assert (trained.num_timesteps, trained._n_updates) == (500, 100)
