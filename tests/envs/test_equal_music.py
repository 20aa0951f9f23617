"""The fast physics plays the same music as the exact one."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_piano.envs import PianoEnv

pytestmark = pytest.mark.slow

# How far the fast profile may be from RoboPianist on its recorded performances.
F1_EACH, F1_MEAN, RETURN_SHARE = 0.03, 0.015, 0.01


def replay(recording, **options):
    """Play recorded actions open loop; return F1 and return."""
    env = PianoEnv(recording.piece, **recording.options, **options)
    env.reset(seed=0)
    total = 0.0
    for action in recording["action"]:
        _, reward, _, truncated, info = env.step(action)
        total += reward
    assert truncated
    return info["f1"], total


def test_recorded_playing_keeps_its_f1_and_its_return_on_the_fast_physics(performances, tell):
    lines, f1_changes = [], []
    for recording in performances:
        recorded_f1, recorded_return = float(recording["f1"]), recording["reward"].sum()
        f1, total = replay(recording, physics="fast")
        f1_changes.append(f1 - recorded_f1)
        return_change = total / recorded_return - 1
        lines.append(
            f"{recording.piece:<32}{recorded_f1:7.3f}{f1:7.3f}{f1 - recorded_f1:+8.3f}"
            f"{recorded_return:8.1f}{total:8.1f}{return_change:+8.2%}"
        )
        assert abs(f1_changes[-1]) < F1_EACH
        assert abs(return_change) < RETURN_SHARE
    heading = f"{'piece':<32}{'F1':>7}{'fast':>7}{'':>8}{'return':>8}{'fast':>8}"
    tell("\n".join([heading, *lines]))
    assert len(f1_changes) == 3
    assert np.mean(np.abs(f1_changes)) < F1_MEAN
