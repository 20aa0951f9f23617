"""A saved moment of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.music import Score


@dataclass(frozen=True, eq=False, kw_only=True)
class EnvState:
    """The physics and the episode's progress, from ``PianoEnv.get_state``; a copy, picklable."""

    physics: npt.NDArray[np.float64]
    """MuJoCo's integration state."""
    score: Score
    """Score that is played."""
    finished: bool
    """Whether the episode has ended."""
    pedal: float
    """The pedal's command in [0, 1]."""
    key_active: npt.NDArray[np.bool_]
    """(step, 88) bool, keys that sounded after each control step."""
    sustain: npt.NDArray[np.bool_]
    """(step,) bool, whether the pedal was down."""
    fingertips: npt.NDArray[np.float64]
    """(step, 10, 3) positions of the fingertips after each control step, m."""
    within: Mapping[int, npt.NDArray[np.bool_]]
    """By control step in which a key went down or up: (p, 88) bool, keys that sounded after each of
    its p physics steps."""
    returns: npt.NDArray[np.float64]
    """(5,) sums so far of the weighted reward terms."""

    @property
    def step(self) -> int:
        """Control steps that are over."""
        return len(self.key_active)
