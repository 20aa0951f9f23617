"""Next goals of each finger, at every control step of a piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import MIN_PITCH, NUM_FINGERS

IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False, kw_only=True)
class FingerGoals:
    """For each of T control steps and ten fingers the note that it holds, or else its next one."""

    key: IntArray
    """(T, 10) key to press, -1 where the finger has nothing more to play within the horizon."""
    onset: IntArray
    """(T, 10) control steps until the key must be down, 0 while it must; at most the horizon."""
    release: IntArray
    """(T, 10) control steps until it must be up again; at most the horizon."""

    @classmethod
    def of(cls, roll: PianoRoll, horizon: int) -> FingerGoals:
        """Look up to ``horizon`` control steps ahead in a piece.

        Where labels give one finger several keys at once, it is shown the lowest.

        Raises:
            ScoreError: If a note has no finger label.
        """
        _check_labels(roll)
        steps = len(roll)
        held = _held_keys(roll)
        key, onset = np.full_like(held, -1), np.full_like(held, horizon)
        release = np.full_like(held, horizon)
        # Steps to the next onset and to the release after it, carried from the end to the start;
        # at first beyond any horizon.
        next_key = np.full(NUM_FINGERS, -1, dtype=np.intp)
        until_onset = np.full(NUM_FINGERS, horizon + 1, dtype=np.intp)
        until_release = until_onset.copy()
        for step in range(steps - 1, -1, -1):
            until_onset, until_release = until_onset + 1, until_release + 1
            holding = held[step] >= 0
            ends = holding & _ends(held, step)
            until_release[ends] = 1
            until_onset[holding] = 0
            next_key[holding] = held[step, holding]
            seen = until_onset <= horizon
            key[step, seen] = next_key[seen]
            onset[step, seen] = until_onset[seen]
            release[step, seen] = np.minimum(until_release[seen], horizon)
        return cls(key=key, onset=onset, release=release)


def _held_keys(roll: PianoRoll) -> IntArray:
    """Return the key that each finger holds, (T, 10), -1 where it holds none."""
    held = np.full((len(roll), NUM_FINGERS), -1, dtype=np.intp)
    steps, keys = np.nonzero(roll.active & (roll.finger >= 0))
    # From the highest key to the lowest, so that the lowest remains.
    order = np.argsort(-keys, kind="stable")
    steps, keys = steps[order], keys[order]
    held[steps, roll.finger[steps, keys]] = keys
    return held


def _ends(held: IntArray, step: int) -> npt.NDArray[np.bool_]:
    """Return for which fingers the note held at a step is over at the next one, (10,) bool.

    A key struck anew is silent for a step before, see :class:`~sb3_piano.music.PianoRoll`.
    """
    if step + 1 == len(held):
        return np.ones(NUM_FINGERS, dtype=bool)
    return np.asarray(held[step + 1] != held[step])


def _check_labels(roll: PianoRoll) -> None:
    unlabelled = np.argwhere(roll.unlabelled)
    if len(unlabelled) > 0:
        step, key = unlabelled[0]
        raise ScoreError(
            f"The note of pitch {key + MIN_PITCH} at control step {step} has no finger label: "
            "the observation 'fingers' expects one for every note. Let fingers be found with "
            "fingering='ergonomic' or 'robot', or choose the observation 'roll' or 'window'."
        )
