"""The command line: from a MIDI file to a played performance, and every way to get it wrong."""

from __future__ import annotations

import argparse
import dataclasses
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import pytest
import yaml
from short_scores import save_tune

import sb3_piano
from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.cli.common import adder
from sb3_piano.cli.main import COMMANDS, parser_of
from sb3_piano.cli.settings import add_settings, given
from sb3_piano.envs import ENV_IDS
from sb3_piano.hyperparams import FINE_TUNING, NAMED, PRESETS
from sb3_piano.music import load_score
from sb3_piano.music.library import Library
from sb3_piano.simulation import PHYSICS_PROFILES

SMALL = Path(__file__).parents[1] / "data" / "small.yml"


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(SMALL, tmp_path)


@pytest.mark.slow
def test_a_midi_file_is_trained_evaluated_and_trained_on(midi_file, tmp_path, capsys, episodes_of):
    train = ["train", "--midi", midi_file.name, "--config", "small.yml", "--seed", "3"]
    assert main([*train, "--no-progress", "--evaluate", "--play"]) == 0
    out = capsys.readouterr().out
    run = tmp_path / "runs" / "sac" / "RoboPianist-v0_1"
    assert "Trained for 60 steps." in out
    assert "runs/sac/RoboPianist-v0_1/model.zip" in out
    assert "tensorboard --logdir runs/sac/RoboPianist-v0_1/tensorboard" in out
    assert "sb3-piano evaluate runs/sac/RoboPianist-v0_1" in out
    assert "  F1  " in out
    assert "no-op baseline" in out
    assert (run / "play" / "performance.wav").is_file()
    episodes = episodes_of(run / "monitor")
    # 1.2 s in steps of 0.05 s, and one in which all is silent again
    assert [episode["l"] for episode in episodes] == [25, 25]
    assert all(0 <= episode["f1"] <= 1 for episode in episodes)

    midi_file.unlink()
    assert main(["evaluate", "runs/sac/RoboPianist-v0_1", "--episodes", "2"]) == 0
    out = capsys.readouterr().out
    assert "2 episodes, model after 60 steps of training" in out
    assert "policy (mean ± std)" in out
    resume = ["train", "--resume", str(run), "--steps", "8e1", "--no-progress", "--algo", "sac"]
    assert main(resume) == 0
    assert "Trained for 80 steps." in capsys.readouterr().out
    assert main(["train", "--resume", str(run)]) == 0
    assert "has done 80 of 80 steps: nothing is left to do" in capsys.readouterr().out


def test_a_training_starts_from_a_run_with_its_piece_or_others_and_with_other_fingers(tmp_path):
    save_tune(tmp_path / "plain.mid")  # without labels
    common = ["--steps", "3", "--no-progress"]
    train = ["train", "--midi", "plain.mid", "--fingering", "ergonomic", "--config", "small.yml"]
    assert main([*train, *common, "--out", "run"]) == 0
    start = ["train", "--init-from", "run", *common]
    assert main([*start, "--fingering", "robot", "--out", "other"]) == 0
    assert main([*start, "--pieces", "scale-[CD]Major", "--n-envs", "2", "--out", "pieces"]) == 0
    assert main([*start, "--midi", "FurElise", "--out", "piece"]) == 0
    assert main([*start, "--with-buffer", "--out", "on"]) == 0
    assert Checkpoint.read(tmp_path / "on" / "checkpoint").replay.total == 3 + 3
    for run, fingering in (("run", "ergonomic"), ("other", "robot")):
        config = yaml.safe_load((tmp_path / run / "config.yml").read_text())
        assert config["env_kwargs"] == {"score": "score.mid", "fingering": fingering}


def test_options_reach_the_run(tmp_path, capsys):
    options = {
        "--env": "Pendulum-v1", "--config": "small.yml", "--algo": "ddpg", "--steps": "4e1",
        "--seed": "0", "--n-envs": "2", "--vec-env": "dummy", "--runs-dir": "elsewhere",
        "--checkpoint-every": "20",
    }  # fmt: skip
    assert main(["train", "--no-progress", *(x for pair in options.items() for x in pair)]) == 0
    config = yaml.safe_load((tmp_path / "elsewhere/ddpg/Pendulum-v1_1/config.yml").read_text())
    assert (config["algo"], config["n_timesteps"], config["seed"]) == ("ddpg", 40, 0)
    assert (config["n_envs"], config["vec_env"]) == (2, "dummy")
    segments = (tmp_path / "elsewhere/ddpg/Pendulum-v1_1/checkpoint").glob("replay-*")
    assert sorted(path.name for path in segments) == ["replay-0-10.npz", "replay-10-20.npz"]


def test_presets_and_environments_are_listed_with_what_they_are_for(tmp_path, monkeypatch, capsys):
    assert main(["presets"]) == 0
    files = [file for of_set in (PRESETS, *NAMED.values(), FINE_TUNING) for file in of_set.values()]
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [*dict.fromkeys(map(str, files))]
    assert lines[0].endswith("  CrossQ for the piano environments")
    assert main(["envs"]) == 0
    listed = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert [env_id for env_id, _ in listed] == list(ENV_IDS)
    assert all(env_id in gym.registry for env_id, _ in listed)
    assert dict(listed)["RoboPianist-scale-CMajor-v0"] == "a scale"
    # Also imported pieces of the benchmark, and of all those that have a text in their name.
    monkeypatch.setenv("SB3_PIANO_DATA", str(tmp_path / "data"))
    for name in ("mine", "etude-12-PartitaNo26"):
        Library().add(load_score("scale-CMajor"), name, source="a test", fingering="ours")
    for text, added in (("", ["RoboPianist-etude-12-PartitaNo26-v0"]), ("SCALE-c", [])):
        assert main(["envs", *filter(None, [text])]) == 0
        listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
        assert listed == [n for n in ENV_IDS if text.lower() in n.lower()] + added != []
    for more, told in (([], "Nothing has 'fsat' in its name"), (["--zoo", "sac"], "mean 'fast'?")):
        assert main(["presets", "fsat", *more]) == 2
        assert told in capsys.readouterr().err


@pytest.mark.parametrize("name", COMMANDS)
def test_each_help_opens_with_a_sentence_and_an_example_that_is_one(name, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([name, "--help"])
    usage, sentence, example, *_ = capsys.readouterr().out.split("\n\n")
    assert usage.startswith(f"usage: sb3-piano {name} ")
    assert sentence.endswith(".")
    program, *given = shlex.split(example)
    assert (program, given[0]) == ("sb3-piano", name)
    assert parser_of(given).parse_args(given).command


def test_help_names_every_physics_profile_and_the_version_is_told(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["evaluate", "--help"])
    told = capsys.readouterr().out.rpartition("--physics NAME")[2].partition("default:")[0]
    whole = re.sub(r"-\s+", "-", told)  # lines are broken at hyphens
    assert set(re.findall("[a-z-]+", whole)) - {"or"} == set(PHYSICS_PROFILES)
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out == f"sb3-piano {sb3_piano.__version__}\n"


@pytest.mark.slow
def test_output_that_nobody_reads_is_no_crash():
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "sb3_piano.cli", "envs"]
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert (done.returncode, done.stderr) == (2, "")


def test_a_shell_completes_commands_and_options(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--completion", "bash"])
    script = capsys.readouterr().out
    asked = "COMP_WORDS=(sb3-piano {}); COMP_CWORD={}; _shtab_sb3_piano; echo ${{COMPREPLY[@]}}"
    for words, number, found in (("pl", 1, "plan play"), ("play --vi", 2, "--view")):
        lines = [script, asked.format(words, number)]
        shell = ["bash", "-c", "\n".join(lines)]
        done = subprocess.run(shell, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == found


def test_options_say_what_the_settings_say_and_give_what_they_take():
    @dataclasses.dataclass
    class Taken:
        """Settings of a test."""

        count: int | None = None
        """How many :class:`~a.B` are taken."""
        shares: tuple[float, ...] = (0.5, 1.0)
        """Shares of ``each``, 100 %."""
        aloud: bool = False
        """Whether it is told."""
        name: str = "none"
        """Name of what is taken; by default nothing."""

    parser = argparse.ArgumentParser()
    add_settings(adder(parser), Taken, "count", "shares", "aloud", "name", name="its name")
    text = " ".join(parser.format_help().split())
    assert "--count N how many a.B are taken" in text
    assert "--shares X [X ...] shares of each, 100 %; default: 0.5 1.0" in text
    assert "--name NAME its name; default: none" in text
    assert given(parser.parse_args([]), Taken) == {}
    chosen = parser.parse_args(["--count", "0", "--shares", "1", "0.25", "--aloud", "--name", "x"])
    assert given(chosen, Taken) == {"count": 0, "shares": [1, 0.25], "aloud": True, "name": "x"}
