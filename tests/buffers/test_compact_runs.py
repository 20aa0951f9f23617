"""Whole runs with a compact buffer, from YAML, are those with SB3's own."""

from __future__ import annotations

import pytest
import torch
import yaml
from stable_baselines3 import TD3
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import Checkpoint
from sb3_piano.training import RunFolder, resume, train
from sb3_piano.training.configuration.yaml_files import load_config

PIANO = "RoboPianist-debug-CMajorScaleOneHand-v0"
SETTINGS = {
    "n_timesteps": 100,
    "n_envs": 2,
    "env_kwargs": {"wrong_press_termination": True, "max_episode_steps": 9},
    "policy_kwargs": {"net_arch": [8]},
    "learning_starts": 20,
    "batch_size": 8,
    "buffer_size": 50,  # goes round in each of the sittings
    "device": "cpu",
}


class CrashAt(BaseCallback):
    """Die at one step of the training; named in configs by its import path."""

    armed = False  # it is not when the run is resumed

    def __init__(self, step):
        super().__init__()
        self.step = step

    def _on_step(self):
        if self.armed and self.num_timesteps == self.step:
            raise RuntimeError("crash")
        return True


def config(tmp_path, buffer, **changes):
    settings = {**SETTINGS, "replay_buffer_class": buffer, **changes}
    path = tmp_path / "td3.yml"
    path.write_text(yaml.safe_dump({PIANO: settings}))
    return load_config("td3", PIANO, path, seed=1)


def crash_and_resume(tmp_path, monkeypatch, buffer, **changes):
    """Crash at step 70, resume from the checkpoint at step 60; return what was learned."""
    folder = tmp_path / buffer.rpartition(".")[2]
    callback = {f"{__name__}.CrashAt": {"step": 70}}
    crashing = config(tmp_path, buffer, callback=callback, **changes)
    with monkeypatch.context() as patch:
        patch.setattr(CrashAt, "armed", True)
        with pytest.raises(RuntimeError, match="crash"):
            train(crashing, folder, progress_bar=False, checkpoint_every=30)
    assert Checkpoint.read(RunFolder.open(folder).checkpoint_dir).num_timesteps == 60
    result = resume(folder, 160, progress_bar=False)
    assert (result.started_at, result.num_timesteps) == (60, 160)
    return TD3.load(result.folder.model_file).policy.state_dict()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ours", "stock", "changes"),
    [
        ("CompactReplayBuffer", "ReplayBuffer", {}),
        ("CompactReplayBuffer", "ReplayBuffer", {"normalize": True}),
        (
            "CompactNStepReplayBuffer",
            "NStepReplayBuffer",
            {"replay_buffer_kwargs": {"n_steps": 3, "gamma": 0.9}},
        ),
    ],
    ids=["plain", "normalized", "n-step"],
)
def test_a_crashed_and_resumed_run_learns_what_it_learns_with_the_stock_buffer(
    tmp_path, monkeypatch, ours, stock, changes
):
    compact = crash_and_resume(tmp_path, monkeypatch, f"sb3_piano.buffers.{ours}", **changes)
    path = f"stable_baselines3.common.buffers.{stock}"
    for name, weights in crash_and_resume(tmp_path, monkeypatch, path, **changes).items():
        assert torch.equal(compact[name], weights), name
