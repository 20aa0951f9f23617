"""Find the fingering that is easiest for a pianist's hand.

Costs depend on up to three onsets in succession. They are computed for patterns, without time and
octave, so that repeated music is computed once.

Keys are pitches as the right hand sees them: the left hand's part is mirrored about D, and is then
treated like a right hand's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from sb3_piano.music.constants import FINGERS_PER_HAND, PITCH_CLASS_IS_BLACK, THUMB, UNKNOWN_FINGER
from sb3_piano.music.fingering.cost import (
    DEFAULT_WEIGHTS,
    MAX_INTERVAL,
    CostTables,
    FingeringWeights,
    cost_tables,
)
from sb3_piano.music.fingering.search import Onset, States, Table, search
from sb3_piano.music.hands import Hand
from sb3_piano.music.note import Note

TOGETHER = 0.03
"""Notes struck within this time of the first, in s, are one chord; as in E. Nakamura et al.,
"Statistical learning and estimation of piano fingering", 2020."""

OVERLAP = 0.05
"""A key released within this time, in s, after the next strike counts as released before it.

Legato notes overlap a little. The value is one control step of RoboPianist (20 Hz).
"""

WIDEST = 16
"""The widest grip of a hand, in semitones; keys held farther away are released.

Source: the medium hand of Balliauw et al. 2017.
"""

_MIRROR = 2 * 62  # sum of a pitch and its mirror image: D4 is its own
_SLOWEST, _FASTEST = 0.3, 2.0  # limits of the factor by which pace weights the costs of movement
_OCTAVE = 12
_CACHE = 8192


@dataclass(frozen=True)
class HandFingering:
    """The fingering found for the part of one hand."""

    fingers: tuple[int, ...]
    """For each note, 0 (thumb) to 4, or -1 without a free finger."""
    cost: float
    """Total cost of the fingering."""
    released: frozenset[int]
    """Indices of notes whose finger leaves the key before the note's end."""


def finger_hand(
    notes: Sequence[Note], hand: Hand, weights: FingeringWeights = DEFAULT_WEIGHTS
) -> HandFingering:
    """Find the fingering with the least cost for one hand's notes, sorted by onset.

    Notes with a finger keep it. If a hand cannot hold all keys (too many, too wide, or no way to
    reach the next ones), it releases the key held longest first.
    """
    found = search(_chords(notes, hand), _Ergonomic(cost_tables(weights)), order=2)
    fingers = [UNKNOWN_FINGER] * len(notes)
    for strike, finger in found.fingers.items():
        for index in strike.notes:
            fingers[index] = finger
    released = frozenset(index for strike in found.released for index in strike.notes)
    return HandFingering(tuple(fingers), found.cost, released)


def struck_together(notes: Sequence[Note]) -> list[list[int]]:
    """Group the indices of notes into chords; `notes` are sorted by onset."""
    chords: list[list[int]] = []
    for index, note in enumerate(notes):
        if not chords or note.onset > notes[chords[-1][0]].onset + TOGETHER:
            chords.append([])
        chords[-1].append(index)
    return chords


# Keys, and all assignments of fingers to them.


@dataclass(slots=True, eq=False)
class _Strike:
    """One strike of a key; notes that double each other share it."""

    key: int
    onset: float
    offset: float
    notes: list[int]
    """Indices of its notes in the part."""
    label: int
    """Its finger, 0 (thumb) to 4, if known beforehand, else -1."""


def _chords(notes: Sequence[Note], hand: Hand) -> Iterator[list[_Strike]]:
    """Yield the keys that a hand strikes together, in order of pitch, if they get a finger."""
    for chord in struck_together(notes):
        strikes: dict[int, _Strike] = {}
        for index in chord:
            note = notes[index]
            key = note.pitch if hand == "right" else _MIRROR - note.pitch
            new = _Strike(key, note.onset, note.offset, [], UNKNOWN_FINGER)
            strike = strikes.setdefault(key, new)
            strike.notes.append(index)
            strike.offset = max(strike.offset, note.offset)
            if strike.label == UNKNOWN_FINGER != note.finger:
                strike.label = note.finger % FINGERS_PER_HAND
        struck = [strikes[key] for key in sorted(strikes)]
        yield [struck[place] for place in _playable(_shape(struck))]


_Shape = tuple[tuple[bool, int], ...]
"""For each key from the thumb's side: whether it is struck now (else held), known finger or -1."""


def _shape(struck: Sequence[_Strike]) -> _Shape:
    return tuple((True, strike.label) for strike in struck)


@lru_cache(maxsize=_CACHE)
def _playable(shape: _Shape) -> list[int]:
    """Return the indices of the struck keys that get a finger.

    Labelled keys always do; if more than five others remain, the outer ones come first.
    """
    labelled = [place for place, (_, label) in enumerate(shape) if label >= 0]
    free = [place for place, (_, label) in enumerate(shape) if label < 0]
    for count in range(min(len(free), FINGERS_PER_HAND), 0, -1):
        # Alternate between both ends.
        outer = [free[turn // 2 if turn % 2 == 0 else -1 - turn // 2] for turn in range(count)]
        places = sorted([*labelled, *outer])
        if any(len(_states(tuple(shape[at] for at in places), order)) for order in (True, False)):
            return places
    return labelled


@lru_cache(maxsize=_CACHE)
def _states(shape: _Shape, in_order: bool) -> States:
    """List every assignment of fingers to keys, in a definite order.

    Each key has its own finger, and with `in_order` fingers follow the order of the keys. Two
    exceptions: the thumb may have passed under fingers that hold keys, or fingers over a thumb
    that does; and labels stay even if two contradict each other.
    """
    choices = [range(FINGERS_PER_HAND) if label < 0 else (label,) for _, label in shape]
    states = np.array(list(product(*choices)), dtype=np.intp)
    fits = np.ones(len(states), dtype=bool)
    for below, above in combinations(range(len(shape)), 2):
        (low_struck, low_label), (high_struck, high_label) = shape[below], shape[above]
        low, high = states[:, below], states[:, above]
        if low_label >= 0 and high_label >= 0:
            continue
        if in_order:
            fits &= (low <= high) | ((high == THUMB) & (not (low_struck and high_struck)))
        fits &= low != high
    return states[fits]


class _Pattern(NamedTuple):
    """Keys that are down, independent of time and octave."""

    pitch_class: int
    """Of the lowest key, 0 is C."""
    intervals: tuple[int, ...]
    """Semitones of each key above the lowest."""
    shape: _Shape
    in_order: bool
    """Whether fingers follow the order of the keys."""

    @property
    def states(self) -> States:
        return _states(self.shape, self.in_order)

    @property
    def struck(self) -> list[int]:
        """Indices of the struck keys."""
        return [place for place, (struck, _) in enumerate(self.shape) if struck]


@dataclass(slots=True)
class _Slice(Onset[_Strike]):
    """Keys that are down, from low to high."""

    pattern: _Pattern
    onset: float
    release: float

    @property
    def lowest(self) -> int:
        return self.down[0].key


class _Ergonomic:
    """Costs of a pianist's fingers: a `CostModel`."""

    def __init__(self, tables: CostTables) -> None:
        self.tables = tables

    def held(
        self, down: list[_Strike], struck: list[_Strike]
    ) -> tuple[list[_Strike], list[_Strike]]:
        onset = min(strike.onset for strike in struck)
        again = {strike.key for strike in struck}
        low, high = struck[0].key, struck[-1].key
        held = [s for s in down if s.offset > onset + OVERLAP and s.key not in again]
        gone = [s for s in held if max(high, s.key) - min(low, s.key) > WIDEST]
        held = sorted((s for s in held if s not in gone), key=lambda s: (s.onset, s.key))
        for strike in list(held):  # the key held longest comes first
            keys = [other.key for other in held] + [low, high]
            crowded = len(held) + len(struck) > FINGERS_PER_HAND
            if crowded or max(keys) - min(keys) > WIDEST:
                held.remove(strike)
                gone.append(strike)
        return held, gone

    def lay(self, path: Sequence[_Slice], held: list[_Strike], struck: list[_Strike]) -> _Slice:
        down = sorted([*held, *struck], key=lambda strike: strike.key)
        low = down[0].key
        pattern = _Pattern(
            low % _OCTAVE,
            tuple(strike.key - low for strike in down),
            tuple((strike not in held, strike.label) for strike in down),
            # Fingers leave the order of the keys only if labels force them to.
            in_order=len(_states(_shape(struck), True)) > 0,
        )
        onset = min(strike.onset for strike in struck)
        release = max(strike.offset for strike in down)
        return _Slice(down, pattern.states, pattern, onset, release)

    def costs(self, path: Sequence[_Slice], onset: _Slice) -> Table:
        own = _own_costs(self.tables, onset.pattern)
        if not path:
            return own
        weights = self.tables.weights
        last = path[-1]
        rise = onset.lowest - last.lowest
        moves, colours = _step_costs(self.tables, last.pattern, onset.pattern, rise)
        calm = _calm(last, onset, weights)
        cost = colours + _speed(onset.onset - last.onset, weights) * calm * moves + own
        if len(path) == 1:
            return cost
        first = path[-2]
        rises = (last.lowest - first.lowest, onset.lowest - first.lowest)
        patterns = (first.pattern, last.pattern, onset.pattern)
        shifts, triples = _shift_costs(self.tables, patterns, rises)
        speed = _speed((onset.onset - first.onset) / 2, weights)
        return speed * _calm(first, last, weights) * calm * shifts + triples + cost


def _speed(time: float, weights: FingeringWeights) -> float:
    return min(max((weights.pace / time) ** weights.haste, _SLOWEST), _FASTEST)


def _calm(first: _Slice, second: _Slice, weights: FingeringWeights) -> float:
    return math.exp(-max(second.onset - first.release, 0.0) / weights.rest)


# Costs of all states of a pattern, and of transitions to the next.


@lru_cache(maxsize=_CACHE)
def _own_costs(tables: CostTables, pattern: _Pattern) -> Table:
    """Compute the cost of each state by itself: (states,); infinite if a held key is out of reach.

    The cost adds up all struck keys with their fingers. Each pair of keys, at least one of them
    struck, adds its grip, divided by the number of other keys.
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
                pairs[tables.far[at]] = np.inf
    return cost + pairs / max(len(pattern.shape) - 1, 1)


@lru_cache(maxsize=_CACHE)
def _step_costs(
    tables: CostTables, first: _Pattern, second: _Pattern, rise: int
) -> tuple[Table, Table]:
    """Compute the costs of each step, with and without dependence on time: (first, second) states.

    The second table is infinite where a finger would leave a held key. `rise` is the interval from
    the lowest key to the next lowest.
    """
    kept = {
        first.intervals.index(second.intervals[place] + rise): place
        for place, (struck, _) in enumerate(second.shape)
        if not struck
    }
    left = [place for place in range(len(first.intervals)) if place not in kept]
    chord = len(left) > 1 or len(second.struck) > 1
    table = tables.chord_moves if chord else tables.moves
    moves = _mean_pairs(table, first, second, rise, left)
    colours = _mean_pairs(tables.colours, first, second, rise, left)
    for place, later in kept.items():
        colours[first.states[:, None, place] != second.states[None, :, later]] = np.inf
    return moves, colours


@lru_cache(maxsize=_CACHE)
def _shift_costs(
    tables: CostTables, patterns: tuple[_Pattern, _Pattern, _Pattern], rises: tuple[int, int]
) -> tuple[Table, Table]:
    """Compute the costs of position changes, with and without dependence on time.

    Both broadcast to (first, second, third) states. The second pattern counts if all three strike
    a single key. `rises` are the intervals from the first lowest key to the others.
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
    table: Table, first: _Pattern, second: _Pattern, rise: int, places: list[int]
) -> Table:
    """Sum the costs of pairs of keys at `places` and keys struck later: (first, second) states.

    The sum is divided by the larger number of keys.
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
