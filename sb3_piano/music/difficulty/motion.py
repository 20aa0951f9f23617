"""Motion that a piece takes: recorded performances, and their features.

The file of a recording is a NumPy archive (.npz) with the arrays of :class:`MotionRecording`;
``sb3-piano evaluate RUN --motion`` writes them.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.files import write_atomically
from sb3_piano.music.constants import NUM_FINGERS


@dataclass(frozen=True, kw_only=True)
class MotionFeatures:
    """Amount of motion in a performance, per control step.

    Performances compare if they have the same action space and length of a control step.
    """

    action_variance: float
    """Variance over the steps of each component of the action, as a mean over the components."""
    hand_motion: float
    """Absolute motion of a joint of the hands from one step to the next, as a mean over steps
    and joints; rad, of the two sliders m."""
    fingertip_motion: float
    """Motion of a fingertip from one step to the next, as a mean over steps and the ten
    fingertips, in m."""


def mean_motion(several: Sequence[MotionFeatures]) -> MotionFeatures:
    """Return the means over several performances of one piece, at least one."""
    names = [field.name for field in fields(MotionFeatures)]
    means = {name: float(np.mean([getattr(one, name) for one in several])) for name in names}
    return MotionFeatures(**means)


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionRecording:
    """Everything that moved in a performance of T control steps.

    Attributes:
        title: What the piece is called.
        actions: (T, n) float32, what was done in each step, in the environment's action space.
        qpos: (T + 1, nq) float64, all joint positions at the start and after each step, rad or m.
        hand_qpos: (m,) int, where in a row of `qpos` the hands' joints stand; the others are keys.
        fingertips: (T + 1, 10, 3) float64, world positions of the fingertips at the same times, in
            the order of finger labels, m.
    """

    title: str
    actions: npt.NDArray[np.float32]
    qpos: npt.NDArray[np.float64]
    hand_qpos: npt.NDArray[np.intp]
    fingertips: npt.NDArray[np.float64]

    def features(self) -> MotionFeatures:
        """Return how much moved.

        Raises:
            ConfigError: If the arrays do not fit together, or a value is not finite.
        """
        self._check()
        joints = self.qpos[:, self.hand_qpos]
        return MotionFeatures(
            action_variance=float(np.var(self.actions, axis=0, dtype=np.float64).mean()),
            hand_motion=float(np.abs(np.diff(joints, axis=0)).mean()),
            fingertip_motion=float(
                np.linalg.norm(np.diff(self.fingertips, axis=0), axis=-1).mean()
            ),
        )

    def _check(self) -> None:
        rows, hands = len(self.actions) + 1, self.hand_qpos
        expected = (rows, NUM_FINGERS, 3)
        if self.actions.ndim != 2 or self.actions.size == 0:
            problem = f"actions have shape {self.actions.shape}: expected (T, n), T steps from 1"
        elif self.qpos.ndim != 2 or len(self.qpos) != rows:
            problem = f"qpos has shape {self.qpos.shape}: expected ({rows}, nq), a row more"
        elif hands.ndim != 1 or hands.dtype.kind not in "iu" or not len(hands):
            problem = f"hand_qpos is {hands}: expected indices of columns of qpos"
        elif not 0 <= hands.min() <= hands.max() < self.qpos.shape[1]:
            problem = f"hand_qpos is {hands}: expected indices of the {self.qpos.shape[1]} columns"
        elif self.fingertips.shape != expected:
            problem = f"fingertips have shape {self.fingertips.shape}: expected {expected}"
        elif not all(np.isfinite(a).all() for a in (self.actions, self.qpos, self.fingertips)):
            problem = "a value is not finite: expected numbers only"
        else:
            return
        raise ConfigError(f"The recorded performance of {self.title!r} is unusable: {problem}.")


_ARRAYS = tuple(field.name for field in fields(MotionRecording))


def write_motion(recording: MotionRecording, path: str | os.PathLike[str]) -> None:
    """Write a recorded performance, whole or not at all.

    Raises:
        ConfigError: If the file cannot be written.
    """
    path = Path(path)
    arrays: dict[str, Any] = {name: getattr(recording, name) for name in _ARRAYS}
    try:
        write_atomically(path, lambda file: np.savez_compressed(file, **arrays))
    except OSError as error:
        raise ConfigError(
            f"Cannot write {str(path)!r}: {error.strerror}; expected a file in a writable folder."
        ) from error


def read_motion(path: str | os.PathLike[str]) -> MotionRecording:
    """Read a recorded performance.

    Raises:
        ConfigError: If there is no such file, or it is no such recording.
    """
    path = Path(path)
    if not path.is_file():
        raise ConfigError(f"There is no recording {str(path)!r}: expected an existing .npz file.")
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in _ARRAYS}
        if arrays["title"].ndim != 0 or arrays["title"].dtype.kind != "U":
            raise ValueError("its title is no text")
        recording = MotionRecording(**{**arrays, "title": str(arrays["title"])})
        recording.features()
    except Exception as error:  # a damaged archive surfaces as whatever zipfile and NumPy raise
        raise ConfigError(
            f"{str(path)!r} is no recording of a performance: {one_line(error)}. Expected a file "
            "that 'sb3-piano evaluate RUN --motion' wrote."
        ) from error
    return recording
