"""RL Zoo trains with our preset as it is."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from sb3_piano.hyperparams import PRESETS

pytest.importorskip("rl_zoo3")

ENV_ID = "RoboPianist-debug-CMajorScaleOneHand-v0"


def test_the_stock_zoo_trains_with_a_preset_and_logs_the_metrics(tmp_path):
    command = [sys.executable, "-m", "rl_zoo3.train", "--algo", "td3", "--env", ENV_ID]
    command += ["--gym-packages", "sb3_piano", "--conf-file", str(PRESETS["td3"]), "-n", "200"]
    command += ["--log-folder", str(tmp_path), "--eval-freq", "-1", "--seed", "1"]
    command += ["--hyperparams", "learning_starts:180", "buffer_size:1000"]
    outcome = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    assert outcome.returncode == 0, outcome.stderr
    run = tmp_path / "td3" / f"{ENV_ID}_1"
    assert (run / f"{ENV_ID}.zip").is_file()
    _, names, *episodes = (run / "0.monitor.csv").read_text().splitlines()
    assert names == "r,l,t,precision,recall,f1"
    assert len(episodes) == 1  # the scale has 151 steps
