"""The search: the fingering of one hand that costs the least over the whole piece.

The costs look at up to three slices in succession, so that the state of the search is a pair of
finger states; with one key at a time these are 25. It is exact (Viterbi 1967) for what a slice
holds, and its time and memory grow with the number of slices.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering.cost import CostTables, Table, cost_tables
from sb3_piano.music.fingering.slices import OVERLAP, Touch, slices
from sb3_piano.music.fingering.states import playable
from sb3_piano.music.fingering.transitions import (
    Pattern,
    pattern_states,
    shift_costs,
    slice_costs,
    step_costs,
    struck_places,
)
from sb3_piano.music.fingering.weights import DEFAULT_WEIGHTS, FingeringWeights
from sb3_piano.music.hands import Hand
from sb3_piano.music.note import Note

WIDEST = 16
"""The widest grip of a hand, in semitones; keys held farther away are let go.

Source: the medium hand of Balliauw et al. 2017.
"""

_SLOWEST, _FASTEST = 0.3, 2.0
"""Between these the time there is weighs the costs of movement."""


@dataclass(frozen=True)
class HandFingering:
    """The fingers found for the part of one hand.

    Attributes:
        fingers: For each note, 0 (thumb) to 4, or -1 if no finger is left for it.
        cost: What the fingering costs.
        released: Indices of notes whose finger had to leave their key before its end.
    """

    fingers: tuple[int, ...]
    cost: float
    released: frozenset[int]


@dataclass(slots=True)
class _Slice:
    """A slice on the way: what is down, and how it was best reached."""

    down: list[Touch]
    pattern: Pattern
    onset: float
    release: float
    speed: float = 1.0
    calm: float = 1.0
    best: Table = field(default_factory=lambda: np.zeros((1, 1)))
    back: NDArray[np.intp] = field(default_factory=lambda: np.zeros((1, 1), dtype=np.intp))


def finger_hand(
    notes: Sequence[Note], hand: Hand, weights: FingeringWeights = DEFAULT_WEIGHTS
) -> HandFingering:
    """Find the fingering of one hand's notes that costs the least.

    Notes that have a finger keep it. When a hand cannot hold all that it should (too many keys,
    too wide, or no way to reach the next ones), it lets go of the key held longest first.

    Args:
        notes: The notes of the hand, sorted by onset.
        hand: Whose they are.
        weights: What makes a fingering hard.
    """
    search = _Search(cost_tables(weights))
    for struck in slices(notes, hand):
        search.add(struck)
    fingers = [UNKNOWN_FINGER] * len(notes)
    for touch, finger in search.fingers():
        for index in touch.notes:
            fingers[index] = finger
    return HandFingering(tuple(fingers), search.cost, frozenset(search.released))


class _Search:
    """The search up to some slice."""

    def __init__(self, tables: CostTables) -> None:
        self.tables = tables
        self.path: list[_Slice] = []
        self.released: set[int] = set()

    @property
    def cost(self) -> float:
        """What the cheapest fingering up to here costs."""
        return float(self.path[-1].best.min()) if self.path else 0.0

    def add(self, struck: list[Touch]) -> None:
        """Go on to the next slice."""
        held = self._held(struck)
        places, in_order = playable(tuple((True, touch.label) for touch in struck))
        struck = [struck[place] for place in places]
        while True:
            step = _slice(held, struck, in_order)
            if len(pattern_states(step.pattern)):
                self._reach(step)
                if math.isfinite(step.best.min()):
                    break
            assert held, "A slice without held keys can always be reached."
            self._release(held, min(held, key=lambda touch: (touch.onset, touch.key)))
        self.path.append(step)

    def fingers(self) -> list[tuple[Touch, int]]:
        """Return the finger of each touch in the cheapest fingering."""
        if not self.path:
            return []
        best = self.path[-1].best
        before, now = np.unravel_index(int(best.argmin()), best.shape)
        found: list[tuple[Touch, int]] = []
        for step in reversed(self.path):
            state = pattern_states(step.pattern)[now]
            places = struck_places(step.pattern)
            found += [(step.down[place], int(state[place])) for place in places]
            before, now = step.back[before, now], before
        return found

    def _held(self, struck: list[Touch]) -> list[Touch]:
        """Return the keys that stay down, of those that the hand had down before."""
        if not self.path:
            return []
        onset = min(touch.onset for touch in struck)
        again = {touch.key for touch in struck}
        held = [
            touch
            for touch in self.path[-1].down
            if touch.offset > onset + OVERLAP and touch.key not in again
        ]
        low, high = struck[0].key, struck[-1].key
        for touch in list(held):
            if max(high, touch.key) - min(low, touch.key) > WIDEST:
                self._release(held, touch)
        for touch in sorted(held, key=lambda touch: (touch.onset, touch.key)):
            keys = [other.key for other in held] + [low, high]
            if len(held) + len(struck) > 5 or max(keys) - min(keys) > WIDEST:
                self._release(held, touch)
        return held

    def _release(self, held: list[Touch], touch: Touch) -> None:
        held.remove(touch)
        self.released.update(touch.notes)

    def _reach(self, step: _Slice) -> None:
        """Find the cheapest way to each state of a slice from those before."""
        own = slice_costs(self.tables, step.pattern)
        if not self.path:
            step.best = own[None, :]
            step.back = np.zeros(step.best.shape, dtype=np.intp)
            return
        last = self.path[-1]
        _set_times(step, last, self.tables.weights)
        kept = tuple(
            (last.down.index(touch), place)
            for place, touch in enumerate(step.down)
            if not step.pattern.shape[place][0]
        )
        rise = step.down[0].key - last.down[0].key
        moves, colours = step_costs(self.tables, last.pattern, step.pattern, rise, kept)
        cost = colours + step.speed * step.calm * moves + own
        if len(self.path) == 1:
            step.best = last.best.T + cost
            step.back = np.zeros(step.best.shape, dtype=np.intp)
            return
        total = last.best[:, :, None] + self._shifts(self.path[-2], last, step)
        step.back = total.argmin(0)
        step.best = np.take_along_axis(total, step.back[None], 0)[0] + cost

    def _shifts(self, first: _Slice, last: _Slice, step: _Slice) -> Table:
        base = first.down[0].key
        rises = (last.down[0].key - base, step.down[0].key - base)
        shifts, triples = shift_costs(self.tables, first.pattern, last.pattern, step.pattern, rises)
        weights = self.tables.weights
        speed = _speed((step.onset - first.onset) / 2, weights)
        return speed * last.calm * step.calm * shifts + triples


def _slice(held: list[Touch], struck: list[Touch], in_order: bool) -> _Slice:
    struck_ids = {id(touch) for touch in struck}
    down = sorted([*held, *struck], key=lambda touch: touch.key)
    low = down[0].key
    pattern = Pattern(
        low % 12,
        tuple(touch.key - low for touch in down),
        tuple((id(touch) in struck_ids, touch.label) for touch in down),
        in_order,
    )
    return _Slice(
        down,
        pattern,
        min(touch.onset for touch in struck),
        max(touch.offset for touch in down),
    )


def _set_times(step: _Slice, last: _Slice, weights: FingeringWeights) -> None:
    step.speed = _speed(step.onset - last.onset, weights)
    step.calm = math.exp(-max(step.onset - last.release, 0.0) / weights.rest)


def _speed(time: float, weights: FingeringWeights) -> float:
    return min(max((weights.pace / time) ** weights.haste, _SLOWEST), _FASTEST)
