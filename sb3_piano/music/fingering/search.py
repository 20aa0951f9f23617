"""The search: the fingering of one hand that costs the least over the whole piece.

The costs look at up to three slices in succession, so that the state of the search is a pair of
finger states; with one key at a time these are 25. It is exact (Viterbi 1967) for what a slice
holds, and its time and memory grow with the number of slices. Costs are those of patterns, which
say nothing of when and in which octave they are played: music that repeats itself is worked out
once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sb3_piano.music.constants import FINGERS_PER_HAND, PITCH_CLASS_IS_BLACK, THUMB, UNKNOWN_FINGER
from sb3_piano.music.fingering.cost import (
    DEFAULT_WEIGHTS,
    MAX_INTERVAL,
    CostTables,
    FingeringWeights,
    Table,
    cost_tables,
)
from sb3_piano.music.fingering.states import OVERLAP, KeyStrike, Pattern, playable, slices
from sb3_piano.music.hands import Hand
from sb3_piano.music.note import Note

WIDEST = 16
"""The widest grip of a hand, in semitones; keys held farther away are let go.

Source: the medium hand of Balliauw et al. 2017.
"""

_SLOWEST, _FASTEST = 0.3, 2.0
"""Between these the time there is weighs the costs of movement."""

_OCTAVE = 12
_CACHE = 8192


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
    for strike, finger in search.fingers():
        for index in strike.notes:
            fingers[index] = finger
    cost = float(search.path[-1].best.min()) if search.path else 0.0
    return HandFingering(tuple(fingers), cost, frozenset(search.released))


@dataclass(slots=True)
class _Slice:
    """A slice on the way: what is down, and how it was best reached."""

    down: list[KeyStrike]
    pattern: Pattern
    onset: float
    release: float
    speed: float = 1.0
    calm: float = 1.0
    best: Table = field(default_factory=lambda: np.zeros((1, 1)))
    back: NDArray[np.intp] = field(default_factory=lambda: np.zeros((1, 1), dtype=np.intp))

    @classmethod
    def of(cls, held: list[KeyStrike], struck: list[KeyStrike], in_order: bool) -> _Slice:
        """Put together what is held and what is struck."""
        struck_ids = {id(strike) for strike in struck}
        down = sorted([*held, *struck], key=lambda strike: strike.key)
        low = down[0].key
        pattern = Pattern(
            low % _OCTAVE,
            tuple(strike.key - low for strike in down),
            tuple((id(strike) in struck_ids, strike.label) for strike in down),
            in_order,
        )
        onset = min(strike.onset for strike in struck)
        return cls(down, pattern, onset, max(strike.offset for strike in down))


class _Search:
    """The search up to some slice."""

    def __init__(self, tables: CostTables) -> None:
        self.tables = tables
        self.path: list[_Slice] = []
        self.released: set[int] = set()

    def add(self, struck: list[KeyStrike]) -> None:
        """Go on to the next slice."""
        held = self._held(struck)
        places, in_order = playable(tuple((True, strike.label) for strike in struck))
        struck = [struck[place] for place in places]
        while True:
            step = _Slice.of(held, struck, in_order)
            if len(step.pattern.states):
                self._reach(step)
                if math.isfinite(step.best.min()):
                    break
            assert held, "A slice without held keys can always be reached."
            self._release(held, min(held, key=_longest_first))
        self.path.append(step)

    def fingers(self) -> list[tuple[KeyStrike, int]]:
        """Return the finger of each strike in the cheapest fingering."""
        if not self.path:
            return []
        best = self.path[-1].best
        before, now = np.unravel_index(int(best.argmin()), best.shape)
        found: list[tuple[KeyStrike, int]] = []
        for step in reversed(self.path):
            state = step.pattern.states[now]
            found += [(step.down[place], int(state[place])) for place in step.pattern.struck]
            before, now = step.back[before, now], before
        return found

    def _held(self, struck: list[KeyStrike]) -> list[KeyStrike]:
        """Return the keys that stay down, of those that the hand had down before."""
        if not self.path:
            return []
        onset = min(strike.onset for strike in struck)
        again = {strike.key for strike in struck}
        held = [
            strike
            for strike in self.path[-1].down
            if strike.offset > onset + OVERLAP and strike.key not in again
        ]
        low, high = struck[0].key, struck[-1].key
        for strike in list(held):
            if max(high, strike.key) - min(low, strike.key) > WIDEST:
                self._release(held, strike)
        for strike in sorted(held, key=_longest_first):
            keys = [other.key for other in held] + [low, high]
            crowded = len(held) + len(struck) > FINGERS_PER_HAND
            if crowded or max(keys) - min(keys) > WIDEST:
                self._release(held, strike)
        return held

    def _release(self, held: list[KeyStrike], strike: KeyStrike) -> None:
        held.remove(strike)
        self.released.update(strike.notes)

    def _reach(self, step: _Slice) -> None:
        """Find the cheapest way to each state of a slice from those before."""
        own = _slice_costs(self.tables, step.pattern)
        if not self.path:
            step.best = own[None, :]
            step.back = np.zeros(step.best.shape, dtype=np.intp)
            return
        last, weights = self.path[-1], self.tables.weights
        step.speed = _speed(step.onset - last.onset, weights)
        step.calm = math.exp(-max(step.onset - last.release, 0.0) / weights.rest)
        kept = tuple(
            (last.down.index(strike), place)
            for place, strike in enumerate(step.down)
            if not step.pattern.shape[place][0]
        )
        rise = step.down[0].key - last.down[0].key
        moves, colours = _step_costs(self.tables, last.pattern, step.pattern, rise, kept)
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
        patterns = (first.pattern, last.pattern, step.pattern)
        shifts, triples = _shift_costs(self.tables, patterns, rises)
        speed = _speed((step.onset - first.onset) / 2, self.tables.weights)
        return speed * last.calm * step.calm * shifts + triples


def _longest_first(strike: KeyStrike) -> tuple[float, int]:
    return strike.onset, strike.key


def _speed(time: float, weights: FingeringWeights) -> float:
    return min(max((weights.pace / time) ** weights.haste, _SLOWEST), _FASTEST)


# Costs for all finger states of a slice, and of going from one slice to the next.


@lru_cache(maxsize=_CACHE)
def _slice_costs(tables: CostTables, pattern: Pattern) -> Table:
    """Return what each state costs by itself: (states,); infinite if a held key is out of reach.

    Each struck key counts with its finger, and each pair of keys of which one is struck at least
    with its grip, in sum over the average number of partners.
    """
    states = pattern.states
    cost, pairs = np.zeros(len(states)), np.zeros(len(states))
    for place, (struck, _) in enumerate(pattern.shape):
        key = (pattern.pitch_class + pattern.intervals[place]) % _OCTAVE
        if struck:
            cost += tables.single[int(PITCH_CLASS_IS_BLACK[key]), states[:, place]]
        for above in range(place + 1, len(pattern.shape)):
            interval = pattern.intervals[above] - pattern.intervals[place]
            at = (key, interval + MAX_INTERVAL, states[:, place], states[:, above])
            other_struck, _ = pattern.shape[above]
            if struck or other_struck:
                pairs += tables.grips[at]
            if struck != other_struck:
                pairs += np.where(tables.far[at], np.inf, 0.0)
    return cost + pairs / max(len(pattern.shape) - 1, 1)


@lru_cache(maxsize=_CACHE)
def _step_costs(
    tables: CostTables,
    first: Pattern,
    second: Pattern,
    rise: int,
    kept: tuple[tuple[int, int], ...],
) -> tuple[Table, Table]:
    """Return what going from each state of a slice to each of the next costs.

    Args:
        tables: The costs of keys and fingers.
        first: The slice that is left.
        second: The slice that follows.
        rise: Its lowest key above that of the first, in semitones.
        kept: For each key held over: its place in the first and in the second slice.

    Returns:
        (first states, second states) each: what depends on the time there is, and what does not;
        the latter is infinite where a finger would have to leave a key that is held.
    """
    left = [place for place in range(len(first.intervals)) if place not in dict(kept)]
    chord = len(left) > 1 or len(second.struck) > 1
    table = tables.chord_moves if chord else tables.moves
    moves = _mean_pairs(table, first, second, rise, left)
    colours = _mean_pairs(tables.colours, first, second, rise, left)
    for place, later in kept:
        colours[first.states[:, None, place] != second.states[None, :, later]] = np.inf
    return moves, colours


@lru_cache(maxsize=_CACHE)
def _shift_costs(
    tables: CostTables, patterns: tuple[Pattern, Pattern, Pattern], rises: tuple[int, int]
) -> tuple[Table, Table]:
    """Return what changes of the hand's position over three slices cost.

    Args:
        tables: The costs of keys and fingers.
        patterns: The slices.
        rises: The lowest keys of the second and the third above that of the first, in semitones.

    Returns:
        What depends on the time there is, and what does not: (first states, second states or 1,
        third states) each. The second slice counts if all three strike a single key.
    """
    first, _, third = patterns
    shifts = _mean_pairs(tables.shifts, first, third, rises[1], first.struck)[:, None, :]
    if any(len(pattern.struck) > 1 for pattern in patterns):
        return tables.weights.chord_shift * shifts, np.zeros((1, 1, 1))
    places = [pattern.struck[0] for pattern in patterns]
    fingers = [p.states[:, place] for p, place in zip(patterns, places, strict=True)]
    one, two, three = (
        pattern.intervals[place] + rise
        for pattern, place, rise in zip(patterns, places, (0, *rises), strict=True)
    )
    triples = tables.triples[np.ix_(*fingers)]
    if not (one < two < three or one > two > three):
        return shifts, triples
    full = _mean_pairs(tables.full_shifts, first, third, rises[1], first.struck)
    passes = (fingers[1] == THUMB)[None, :, None]
    return np.where(passes, full[:, None, :], shifts), triples


def _mean_pairs(
    table: Table, first: Pattern, second: Pattern, rise: int, places: list[int]
) -> Table:
    """Sum a cost over pairs of keys, over the larger number of keys: (first states, second states).

    Args:
        table: The cost of two keys with two fingers.
        first: A slice ...
        second: ... and a later one, whose struck keys count.
        rise: Its lowest key above that of the first, in semitones.
        places: Which keys of the first one count.
    """
    one, other, later = first.states, second.states, second.struck
    if not places or not later:
        return np.zeros((len(one), len(other)))
    keys = np.array([first.intervals[place] for place in places])
    keys_later = np.array([second.intervals[place] for place in later]) + rise
    interval = keys_later[None, :] - keys[:, None] + MAX_INTERVAL
    pitch_class = (first.pitch_class + keys[:, None]) % _OCTAVE
    costs = table[pitch_class, interval, one[:, None, places, None], other[None, :, None, later]]
    return np.asarray(costs.sum((2, 3)) / max(len(places), len(later)))
