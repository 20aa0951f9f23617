"""A range of neighbouring keys, and what of an observation belongs to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sb3_piano.envs.observation import IntArray, ObservationLayout
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import MIN_PITCH, NUM_KEYS


@dataclass(frozen=True)
class KeyWindow:
    """The keys ``first`` to ``last``, both included, of 0 (A0) to 87 (C8)."""

    first: int
    """Lowest key."""
    last: int
    """Highest key."""

    @classmethod
    def of(cls, roll: PianoRoll, margin: int) -> KeyWindow:
        """Return the keys that a piece uses, and up to ``margin`` more on either side."""
        used = np.flatnonzero(roll.active.any(axis=0))
        if len(used) == 0:
            return ALL_KEYS
        return cls(max(int(used[0]) - margin, 0), min(int(used[-1]) + margin, NUM_KEYS - 1))

    @property
    def slice(self) -> slice:
        """The window's keys among all keys."""
        return slice(self.first, self.last + 1)

    def __len__(self) -> int:
        return self.last + 1 - self.first

    def check(self, roll: PianoRoll) -> None:
        """Make sure that a piece stays within the window.

        Raises:
            ScoreError: If it does not; the message names the pitches.
        """
        used = np.flatnonzero(roll.active.any(axis=0))
        outside = used[(used < self.first) | (used > self.last)]
        if len(outside) > 0:
            pitches = ", ".join(str(key + MIN_PITCH) for key in outside)
            raise ScoreError(
                f"The piece has notes of pitch {pitches}, but the observation shows only the keys "
                f"of pitch {self.first + MIN_PITCH} to {self.last + MIN_PITCH}: expected a piece "
                "within them, or an environment made for this one."
            )

    def restrict(self, layout: ObservationLayout) -> tuple[ObservationLayout, IntArray]:
        """Return what remains of a layout with one number per key, see its ``restrict``."""
        keys = np.arange(self.first, self.last + 1)
        return layout.restrict({"goal": np.append(keys, NUM_KEYS), "key_state": keys})


ALL_KEYS = KeyWindow(0, NUM_KEYS - 1)
"""The whole keyboard."""
