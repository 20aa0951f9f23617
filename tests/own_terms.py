"""Reward terms that tests add from outside of the package, by their import paths."""

import numpy as np

from sb3_piano.envs import StepView, Term


def smooth(step: StepView) -> float:
    """Return minus the squared change of the controls."""
    return -float(np.square(step.controls_change).sum())


def _steps(goal):
    return len(goal)


def _still(step: StepView) -> float:
    return float(not step.controls_change.any())


still = Term(_still, weight=0.25, best=_steps, label="hands that rest")
broken = 3
