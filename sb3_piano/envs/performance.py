"""What was played in an episode, step by step; all music metrics come from this record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics import episode_metrics
from sb3_piano.music import PianoRoll, Score, score_from_activation

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class Performance:
    """The control steps of an episode so far, beside the roll that should have been played."""

    roll: PianoRoll
    """What should be played, for the whole piece."""
    key_active: BoolArray
    """(t, 88) bool, keys that sounded at the end of each control step."""
    sustain: BoolArray
    """(t,) bool, whether the pedal was down."""

    def __len__(self) -> int:
        return len(self.key_active)

    def metrics(self) -> dict[str, float]:
        """Return the music metrics by name, over the steps that were played."""
        steps = len(self)
        return episode_metrics(
            self.roll.active[:steps], self.key_active, self.roll.sustain[:steps], self.sustain
        )

    def to_score(self, title: str = "performance") -> Score | None:
        """Return what was played as a score, or ``None`` if no key was ever pressed.

        Its times are those of the roll, the initial silence included.
        """
        return score_from_activation(
            self.key_active, self.sustain, self.roll.control_timestep, title=title
        )
