"""Runs of pianos with one hand, and without hands."""

import pytest

from sb3_piano.cli import main
from sb3_piano.training import evaluate, load_config, train


@pytest.mark.slow
@pytest.mark.parametrize("hands", ["right", "none"])
def test_a_run_is_trained_judged_watched_and_reported(hands, midi_file, tmp_path, capsys):
    small = {"n_timesteps": 32, "n_envs": 1, "n_steps": 16, "batch_size": 16, "n_epochs": 1}
    small |= {"policy_kwargs": {"net_arch": [8]}, "callback": []}
    played = {"score": str(midi_file), "physics": "fast", "hands_in_scene": hands}
    config = load_config("ppo", "RoboPianist-v0", env_kwargs=played, **small)
    run = tmp_path / "run"
    train(config, run)
    found = evaluate(run, motion=True)
    assert found.mean["length"] > 20
    returns = {name for name in found.mean if name.startswith("return_")}
    assert ("return_distance" in returns) == (hands == "none")
    assert ("return_fingering" in returns) == (hands != "none")
    assert main(["play", str(run), "--size", "64x48", "--no-progress"]) == 0
    assert main(["report", str(run)]) == 0
    assert (run / "play" / "performance.mp4").stat().st_size > 1000
    assert "report.html" in capsys.readouterr().out
