"""The record of an episode: what sounded and what was earned in each control step."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from sb3_piano.envs.performance import Performance
from sb3_piano.envs.rewards import RETURN_KEYS
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import NUM_KEYS

BoolArray = npt.NDArray[np.bool_]


class EpisodeRecord:
    """Grows by one control step at a time, up to the length of the roll."""

    def __init__(self, roll: PianoRoll):
        """Begin an empty record.

        Args:
            roll: What should be played.
        """
        self._roll = roll
        self._key_active = np.zeros((len(roll), NUM_KEYS), dtype=bool)
        self._sustain = np.zeros(len(roll), dtype=bool)
        self.returns = np.zeros(len(RETURN_KEYS))
        """(5,) sums so far of the weighted reward terms, in the order of ``RETURN_KEYS``."""
        self.steps = 0
        """Control steps that are over."""

    def add(
        self, sounding: BoolArray, pedal_down: bool, weighted_terms: Mapping[str, float]
    ) -> None:
        """Note down a control step.

        Args:
            sounding: (88,) bool, keys that sound at its end.
            pedal_down: Whether the pedal is down.
            weighted_terms: The weighted reward terms, in the order of ``RETURN_KEYS``.
        """
        self._key_active[self.steps] = sounding
        self._sustain[self.steps] = pedal_down
        self.returns += list(weighted_terms.values())
        self.steps += 1

    def performance(self) -> Performance:
        """Return a copy of what was played so far."""
        return Performance(
            roll=self._roll,
            key_active=self._key_active[: self.steps].copy(),
            sustain=self._sustain[: self.steps].copy(),
        )

    def summary(self) -> dict[str, float]:
        """Return the music metrics and the returns by name, as they stand in the final ``info``."""
        returns = zip(RETURN_KEYS, self.returns.tolist(), strict=True)
        return {**self.performance().metrics(), **dict(returns)}

    def restore(
        self, key_active: BoolArray, sustain: BoolArray, returns: npt.NDArray[np.float64]
    ) -> None:
        """Take over the steps, (t, 88) and (t,) bool, and the returns of another record."""
        self.steps = len(key_active)
        self._key_active[: self.steps] = key_active
        self._sustain[: self.steps] = sustain
        self.returns[:] = returns
