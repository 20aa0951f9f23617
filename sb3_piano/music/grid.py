"""The grid of control steps on which notes are laid."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sb3_piano.music.constants import NUM_KEYS, UNKNOWN_FINGER

MAX_STEPS = 1_000_000
"""Longest grid, in control steps: 13.9 hours at 0.05 s, 260 MB. Longer ones are broken files."""

_DECIMALS = 6
"""Decimals kept of a time in steps: 0.15 s / 0.05 s is 2.9999999999999996, meant as 3."""


class Sheet:
    """The arrays of a roll while its notes are laid, in order of onset."""

    def __init__(self, steps: int) -> None:
        self.active = np.zeros((steps, NUM_KEYS), dtype=bool)
        self.finger = np.full((steps, NUM_KEYS), UNKNOWN_FINGER, dtype=np.int8)
        self.onset = np.zeros((steps, NUM_KEYS), dtype=bool)
        self._last_onset = [-1] * NUM_KEYS

    def lay(self, key: int, start: int, end: int, finger: int) -> int | None:
        """Let `key` sound from step `start` until before `end`, as a strike of its own if it can.

        Whether a note is a new strike is seen from the step before it; `first` is the step at
        which that strike becomes audible.

        Returns:
            The first step of the strike, or None if the note is none of its own.
        """
        last = self._last_onset[key]
        if start < last:
            # A strike at this very step was laid before, and its silent step is this one.
            first, strikes = last, False
        elif start == 0 or not self.active[start - 1, key]:
            first, strikes = start, True
        elif end - start > 1:
            first, strikes = start + 1, True
            self._silence(start, key)
        elif start - 1 > last:
            first, strikes = start, True
            self._silence(start - 1, key)
        else:
            first, strikes = start, False
        self.active[first:end, key] = True
        self.finger[first:end, key] = finger
        if not strikes:
            return None
        self.onset[first, key] = True
        self._last_onset[key] = first
        return first

    def _silence(self, step: int, key: int) -> None:
        self.active[step, key] = False
        self.finger[step, key] = UNKNOWN_FINGER


def in_steps(times: ArrayLike, control_timestep: float) -> NDArray[np.float64]:
    """Return times (s) as multiples of the control time step, rid of rounding noise."""
    return np.round(np.asarray(times, dtype=float) / control_timestep, _DECIMALS)


def floor_steps(times: ArrayLike, control_timestep: float) -> NDArray[np.int64]:
    """Return the steps in which the given times (s) lie; `MAX_STEPS` for what lies beyond."""
    return np.floor(np.minimum(in_steps(times, control_timestep), MAX_STEPS)).astype(np.int64)


def ceil_steps(times: ArrayLike, control_timestep: float) -> NDArray[np.int64]:
    """Return the first steps that begin at or after the given times (s)."""
    return np.ceil(np.minimum(in_steps(times, control_timestep), MAX_STEPS)).astype(np.int64)
