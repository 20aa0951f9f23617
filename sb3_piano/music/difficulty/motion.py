"""How much has to move for a piece to be played: features of a recorded performance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.constants import NUM_FINGERS

Array = npt.NDArray[np.floating]


@dataclass(frozen=True, kw_only=True)
class MotionFeatures:
    """How much moved in a performance, per control step.

    Performances compare if they have the same action space and length of a control step.
    """

    action_variance: float
    """Variance over the steps of each component of the action, as a mean over the components."""
    hand_motion: float
    """How far a joint of the hands moves from one step to the next, absolute, as a mean over steps
    and joints; rad, of the two sliders m."""
    fingertip_motion: float
    """How far a fingertip moves from one step to the next, as a mean over steps and the ten
    fingertips, in m."""


def motion_features(actions: Array, joints: Array, fingertips: Array) -> MotionFeatures:
    """Return the features of a recorded performance of T control steps.

    Args:
        actions: (T, n) what was done in each step, T at least 1.
        joints: (T + 1, m) positions of the hands' joints at the start and after each step, in rad
            or m; without the keys.
        fingertips: (T + 1, 10, 3) positions of the fingertips at the same times, in m.

    Raises:
        ConfigError: If a shape is another, or a value is not finite.
    """
    _check_shapes(actions, joints, fingertips)
    return MotionFeatures(
        action_variance=float(np.var(actions, axis=0, dtype=np.float64).mean()),
        hand_motion=float(np.abs(np.diff(joints, axis=0)).mean()),
        fingertip_motion=float(np.linalg.norm(np.diff(fingertips, axis=0), axis=-1).mean()),
    )


def mean_motion(several: Sequence[MotionFeatures]) -> MotionFeatures:
    """Return the means over several performances of one piece, at least one."""
    return MotionFeatures(
        action_variance=float(np.mean([motion.action_variance for motion in several])),
        hand_motion=float(np.mean([motion.hand_motion for motion in several])),
        fingertip_motion=float(np.mean([motion.fingertip_motion for motion in several])),
    )


def _check_shapes(actions: Array, joints: Array, fingertips: Array) -> None:
    steps = len(actions)
    if actions.ndim != 2 or actions.size == 0:
        raise ConfigError(
            f"Actions of shape {actions.shape} are no performance: expected (T, n), T steps from 1."
        )
    if joints.ndim != 2 or len(joints) != steps + 1 or joints.size == 0:
        raise ConfigError(
            f"Joint positions have shape {joints.shape}: expected ({steps + 1}, m), one row more "
            "than there are actions."
        )
    expected = (steps + 1, NUM_FINGERS, 3)
    if fingertips.shape != expected:
        raise ConfigError(f"Fingertips have shape {fingertips.shape}: expected {expected}.")
    for name, values in (("Actions", actions), ("Joints", joints), ("Fingertips", fingertips)):
        if not np.isfinite(values).all():
            raise ConfigError(f"{name} have a value that is not finite: expected numbers only.")
