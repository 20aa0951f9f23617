"""Keys that a hand can hold at the same time, and notes it releases early for others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from sb3_piano.planning.key_places import KeyPlaces
from sb3_piano.planning.presses import Press

# How far apart two fingertips can press white keys, by inverse kinematics of the hand, less a
# margin for other keys and fingers; m. Rows and columns are fingers, from thumb to little finger.
_NEAREST = np.array(
    [
        [0.0, 0.000, 0.010, 0.020, 0.030],
        [0.0, 0.000, 0.012, 0.028, 0.040],
        [0.0, 0.000, 0.000, 0.012, 0.025],
        [0.0, 0.000, 0.000, 0.000, 0.012],
    ]
)
_FARTHEST = np.array(
    [
        [0.0, 0.074, 0.096, 0.140, 0.180],
        [0.0, 0.000, 0.060, 0.098, 0.102],
        [0.0, 0.000, 0.000, 0.070, 0.078],
        [0.0, 0.000, 0.000, 0.000, 0.066],
    ]
)

# So far out of reach, m, fingers end up between the keys. Of 18 such grips of two white keys, held
# for a second, each came out at a higher F1 with one of them alone (0.79, not 0.26 to 0.77).
_MAX_OVERREACH = 0.018


@dataclass(frozen=True)
class EarlyRelease:
    """A note that is not held to its end, as the hand cannot."""

    press: Press
    """The note as it is written."""
    last: int
    """Last state in which the key is down; before ``press.first`` if it is not struck at all."""
    for_key: int
    """The key that is played instead, 0 to 87."""


def out_of_reach(apart: float, finger: int, other: int) -> float:
    """Return how far two keys are from what two fingers can hold, 0 or more m.

    Args:
        apart: How much nearer to the little finger's side the second key is, m.
        finger: The finger on the first one, 0 (thumb) to 3.
        other: The finger on the second one, more than ``finger``.
    """
    farthest, nearest = _FARTHEST[finger, other], _NEAREST[finger, other]
    return float(max(apart - farthest, nearest - apart, 0.0))


def early_releases(
    presses: Sequence[Press], fingers: Sequence[int], sign: int, keys: KeyPlaces
) -> list[EarlyRelease]:
    """Return the notes that a hand has to release early so that it can play the others.

    What is held already makes way for what is struck. Of a chord that cannot be struck, the note
    goes that is out of reach for most of the others; of equals, the one nearest to the thumb.

    Args:
        presses: What the hand plays, in order of time.
        fingers: The finger of each, 0 to 4.
        sign: 1 for the right hand, -1 for the left one.
        keys: The keyboard.
    """
    grips = _Grips(presses, fingers, [sign * float(keys.y[press.key]) for press in presses])
    releases: list[EarlyRelease] = []
    held: list[int] = []
    for onset, chord in groupby(range(len(presses)), key=lambda i: presses[i].first):
        struck = list(chord)
        held = [i for i in held if presses[i].last >= onset]
        while conflicts := grips.conflicts(
            most_conflicting := grips.most_conflicting(struck), struck
        ):
            struck.remove(most_conflicting)
            releases.append(
                EarlyRelease(presses[most_conflicting], onset - 1, presses[conflicts[0]].key)
            )
        stay = []
        for i in held:
            if conflicts := grips.conflicts(i, struck):
                releases.append(EarlyRelease(presses[i], onset - 1, presses[conflicts[0]].key))
            else:
                stay.append(i)
        held = stay + struck
    return releases


@dataclass(frozen=True)
class _Grips:
    """Pairs of presses of one hand that can be held together."""

    presses: Sequence[Press]
    fingers: Sequence[int]
    across: Sequence[float]
    """Place of each press, from the thumb's side to the little finger's, m."""

    def conflicts(self, i: int, others: Sequence[int]) -> list[int]:
        """Return which of the others cannot be held beside a press."""
        return [j for j in others if j != i and not self._holds(i, j)]

    def most_conflicting(self, struck: Sequence[int]) -> int:
        """Return the press with the most conflicts, of equals the one nearest to the thumb."""
        return max(struck, key=lambda i: (len(self.conflicts(i, struck)), -self.across[i]))

    def _holds(self, i: int, j: int) -> bool:
        low, high = sorted((i, j), key=lambda k: self.across[k])
        finger, other = self.fingers[low], self.fingers[high]
        if finger >= other:  # fingers that cross are another matter
            return finger != other
        return out_of_reach(self.across[high] - self.across[low], finger, other) <= _MAX_OVERREACH
