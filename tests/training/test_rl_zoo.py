"""RL Zoo trains with our preset as it is."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from every_callback import ENV_ID as ANY_SCORE_ID
from every_callback import LOGGED, check_what_was_written, tensorboard_names, write_yaml

from sb3_piano.hyperparams import PRESETS

pytestmark = pytest.mark.slow

pytest.importorskip("rl_zoo3")

ENV_ID = "RoboPianist-debug-CMajorScaleOneHand-v0"


def train_in_the_stock_zoo(env_id, file, folder, *options):
    """Run RL Zoo's own command and return what it printed."""
    command = [sys.executable, "-m", "rl_zoo3.train", "--algo", "td3", "--env", env_id]
    command += ["--gym-packages", "sb3_piano", "--conf-file", str(file), "--seed", "1"]
    command += ["--log-folder", str(folder), "--eval-freq", "-1", *options]
    outcome = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    assert outcome.returncode == 0, outcome.stderr
    return outcome.stdout


def test_the_stock_zoo_trains_with_a_preset_and_logs_the_metrics(tmp_path):
    options = ["-n", "200", "--hyperparams", "learning_starts:180", "buffer_size:1000"]
    train_in_the_stock_zoo(ENV_ID, PRESETS["td3"], tmp_path, *options)
    run = tmp_path / "td3" / f"{ENV_ID}_1"
    assert (run / f"{ENV_ID}.zip").is_file()
    _, names, *episodes = (run / "0.monitor.csv").read_text().splitlines()
    assert names == "r,l,t,precision,recall,f1,onset_f1"
    assert len(episodes) == 1  # the scale has 151 steps


def test_every_callback_from_one_yaml_file_in_the_stock_zoo(midi_file, tmp_path):
    write_yaml(tmp_path / "all.yml", midi_file, tmp_path)
    options = ["--tensorboard-log", str(tmp_path / "tb"), "--log-interval", "1"]
    train_in_the_stock_zoo(ANY_SCORE_ID, tmp_path / "all.yml", tmp_path / "logs", *options)
    check_what_was_written(tmp_path)
    found = tensorboard_names(tmp_path / "tb" / ANY_SCORE_ID / "TD3_1")
    assert set(found) >= LOGGED
    assert set(found["eval/onset_f1"]) == {100, 200}
    # the evaluations, of 25 steps each, left no line in the training's file
    run = tmp_path / "logs" / "td3" / f"{ANY_SCORE_ID}_1"
    assert len((run / "0.monitor.csv").read_text().splitlines()) == 2 + 200 // 25
