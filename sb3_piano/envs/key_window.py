"""A range of neighbouring keys, and what of an observation belongs to it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pretty_midi

from sb3_piano.envs.observation import IntArray, ObservationBlock, ObservationLayout
from sb3_piano.exceptions import ConfigError, ScoreError
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
        return cls.around(_used_keys(roll), margin)

    @classmethod
    def around(cls, keys: Iterable[int], margin: int) -> KeyWindow:
        """Return some keys with all between them and up to ``margin`` more on either side.

        Args:
            keys: Keys, 0 to 87; without any, the window is the whole keyboard.
            margin: How many keys more, 0 or more; the keyboard's ends may leave fewer.
        """
        keys = set(keys)
        if not keys:
            return ALL_KEYS
        return cls(max(min(keys) - margin, 0), min(max(keys) + margin, NUM_KEYS - 1))

    @property
    def slice(self) -> slice:
        """The window's keys among all keys."""
        return slice(self.first, self.last + 1)

    def __len__(self) -> int:
        return self.last + 1 - self.first

    def __str__(self) -> str:
        low, high = self.first + MIN_PITCH, self.last + MIN_PITCH
        return f"of pitch {low} to {high} ({_name(low)} to {_name(high)})"

    def check(self, roll: PianoRoll) -> None:
        """Make sure that a piece stays within the window.

        Raises:
            ScoreError: If it does not; the message names the notes.
        """
        self.check_keys(_used_keys(roll))

    def check_keys(
        self, keys: Iterable[int], instead: str = "an environment made for this one"
    ) -> None:
        """Make sure that the keys of a piece lie in the window.

        Args:
            keys: The keys that the piece uses, 0 to 87.
            instead: What would show the piece, for the message.

        Raises:
            ScoreError: If some do not; the message names the notes.
        """
        beyond = [
            key + MIN_PITCH for key in sorted(set(keys)) if not self.first <= key <= self.last
        ]
        if beyond:
            names, pitches = ", ".join(map(_name, beyond)), ", ".join(map(str, beyond))
            raise ScoreError(
                f"The piece has {names}, of pitch {pitches}, but the observation shows only the "
                f"keys {self}: expected a piece within them, or {instead}."
            )

    def restrict(self, layout: ObservationLayout) -> tuple[ObservationLayout, IntArray]:
        """Return what remains of a layout with one number per key, see its ``restrict``.

        Args:
            layout: Its goal and its key state may have been cut before.

        Raises:
            ConfigError: If it does not have all keys of the window.
        """
        keys = np.arange(self.first, self.last + 1)
        goal, key_state = layout["goal"], layout["key_state"]
        kept = {
            "goal": self._positions(goal, np.append(keys, NUM_KEYS)),
            "key_state": self._positions(key_state, keys),
        }
        return layout.restrict(kept)

    def _positions(self, block: ObservationBlock, wanted: IntArray) -> IntArray:
        """Return where columns of an uncut block stand in what remains of it."""
        position = {column: index for index, column in enumerate(block.all_columns.tolist())}
        missing = [column for column in wanted.tolist() if column not in position]
        if missing:
            raise ConfigError(
                f"The keys {self} cannot be cut out of the block {block.name!r}, from which "
                f"{len(missing)} of them were cut before, such as {_name(missing[0] + MIN_PITCH)}: "
                "expected keys that it shows."
            )
        return np.array([position[column] for column in wanted.tolist()])


ALL_KEYS = KeyWindow(0, NUM_KEYS - 1)
"""The whole keyboard."""


def _used_keys(roll: PianoRoll) -> list[int]:
    used: list[int] = np.flatnonzero(roll.active.any(axis=0)).tolist()
    return used


def _name(pitch: int) -> str:
    name: str = pretty_midi.note_number_to_name(pitch)
    return name
