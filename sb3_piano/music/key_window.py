"""Range of neighbouring keys."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import MIN_PITCH, NUM_KEYS
from sb3_piano.music.pitch import pitch_name
from sb3_piano.music.roll import PianoRoll


@dataclass(frozen=True)
class KeyWindow:
    """Range of keys from ``first`` to ``last``, inclusive, of 0 (A0) to 87 (C8)."""

    first: int
    """Lowest key."""
    last: int
    """Highest key."""

    @classmethod
    def of(cls, roll: PianoRoll, margin: int) -> KeyWindow:
        """Make the window of a piece's keys and up to ``margin`` more on either side."""
        return cls.around(roll.used_keys, margin)

    @classmethod
    def around(cls, keys: Iterable[int], margin: int) -> KeyWindow:
        """Make the window around some keys with up to ``margin`` more on either side.

        Without any keys it is the whole keyboard.
        """
        keys = set(keys)
        if not keys:
            return ALL_KEYS
        return cls(max(min(keys) - margin, 0), min(max(keys) + margin, NUM_KEYS - 1))

    @property
    def slice(self) -> slice:
        """Slice of the window's keys among all keys."""
        return slice(self.first, self.last + 1)

    def __len__(self) -> int:
        return self.last + 1 - self.first

    def __str__(self) -> str:
        low, high = self.first + MIN_PITCH, self.last + MIN_PITCH
        return f"of pitch {low} to {high} ({pitch_name(low)} to {pitch_name(high)})"

    def check_keys(
        self, keys: Iterable[int], instead: str = "an environment made for this one"
    ) -> None:
        """Raise a ScoreError, which recommends ``instead``, if keys of a piece are not in it."""
        beyond = [key + MIN_PITCH for key in sorted(set(keys) - {*range(NUM_KEYS)[self.slice]})]
        if beyond:
            names, pitches = ", ".join(map(pitch_name, beyond)), ", ".join(map(str, beyond))
            raise ScoreError(
                f"The piece has {names}, of pitch {pitches}, but the observation shows only the "
                f"keys {self}: expected a piece within them, or {instead}."
            )


ALL_KEYS = KeyWindow(0, NUM_KEYS - 1)
"""The whole keyboard."""
