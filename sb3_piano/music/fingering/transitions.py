"""The costs of a slice, and of going from one slice to the next, for all their finger states.

A slice enters here as a `Pattern`, which says nothing of when and in which octave it is played,
so that music which repeats itself is worked out once.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sb3_piano.music.constants import PITCH_CLASS_IS_BLACK, THUMB
from sb3_piano.music.fingering.cost import MAX_INTERVAL, CostTables, Table
from sb3_piano.music.fingering.states import Shape, States, finger_states

_CACHE = 8192

_OCTAVE = 12


class Pattern(NamedTuple):
    """What is down in a slice.

    Attributes:
        pitch_class: Of the lowest key, 0 is C.
        intervals: Of each key above the lowest, in semitones.
        shape: Which keys are struck, and the fingers known beforehand.
        in_order: Whether fingers follow the order of the keys.
    """

    pitch_class: int
    intervals: tuple[int, ...]
    shape: Shape
    in_order: bool = True


@lru_cache(maxsize=_CACHE)
def pattern_states(pattern: Pattern) -> States:
    """Return the finger states of a slice."""
    return finger_states(pattern.shape, pattern.in_order)


@lru_cache(maxsize=_CACHE)
def struck_places(pattern: Pattern) -> tuple[int, ...]:
    """Return the places of the keys that are struck."""
    return tuple(place for place, (struck, _) in enumerate(pattern.shape) if struck)


@lru_cache(maxsize=_CACHE)
def slice_costs(tables: CostTables, pattern: Pattern) -> Table:
    """Return what each state costs by itself: (states,); infinite if a held key is out of reach.

    Each struck key counts with its finger, and each pair of keys of which one is struck at least
    with its grip, in sum over the average number of partners.
    """
    states = pattern_states(pattern)
    cost = np.zeros(len(states))
    pairs = np.zeros(len(states))
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
def step_costs(
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
    struck = struck_places(second)
    chord = len(left) > 1 or len(struck) > 1
    table = tables.chord_moves if chord else tables.moves
    moves = _mean_pairs(table, first, second, rise, left, struck)
    colours = _mean_pairs(tables.colours, first, second, rise, left, struck)
    one, other = pattern_states(first), pattern_states(second)
    for place, later in kept:
        colours[one[:, None, place] != other[None, :, later]] = np.inf
    return moves, colours


@lru_cache(maxsize=_CACHE)
def shift_costs(
    tables: CostTables,
    first: Pattern,
    second: Pattern,
    third: Pattern,
    rises: tuple[int, int],
) -> tuple[Table, Table]:
    """Return what changes of the hand's position over three slices cost.

    Args:
        tables: The costs of keys and fingers.
        first: The first slice.
        second: The second slice.
        third: The third slice.
        rises: The lowest keys of the second and the third above that of the first, in semitones.

    Returns:
        What depends on the time there is, and what does not: (first states, second states or 1,
        third states) each. The second slice counts if all three strike a single key.
    """
    struck = [struck_places(pattern) for pattern in (first, second, third)]
    shifts = _mean_pairs(tables.shifts, first, third, rises[1], struck[0], struck[2])[:, None, :]
    if any(len(places) > 1 for places in struck):
        return tables.weights.chord_shift * shifts, np.zeros((1, 1, 1))
    fingers = [
        pattern_states(pattern)[:, places[0]]
        for pattern, places in zip((first, second, third), struck, strict=True)
    ]
    keys = [
        pattern.intervals[places[0]] + rise
        for pattern, places, rise in zip((first, second, third), struck, (0, *rises), strict=True)
    ]
    triples = tables.triples[np.ix_(*fingers)]
    if not (keys[0] < keys[1] < keys[2] or keys[0] > keys[1] > keys[2]):
        return shifts, triples
    full = _mean_pairs(tables.full_shifts, first, third, rises[1], struck[0], struck[2])
    passes = (fingers[1] == THUMB)[None, :, None]
    return np.where(passes, full[:, None, :], shifts), triples


def _mean_pairs(
    table: NDArray[np.float64],
    first: Pattern,
    second: Pattern,
    rise: int,
    places: list[int] | tuple[int, ...],
    later: tuple[int, ...],
) -> Table:
    """Sum a cost over all pairs of keys, over the larger number of keys: (states, states)."""
    one, other = pattern_states(first), pattern_states(second)
    if not places or not later:
        return np.zeros((len(one), len(other)))
    keys = np.array([first.intervals[place] for place in places])
    keys_later = np.array([second.intervals[place] for place in later]) + rise
    interval = keys_later[None, :] - keys[:, None] + MAX_INTERVAL
    pitch_class = (first.pitch_class + keys[:, None]) % _OCTAVE
    costs = table[
        pitch_class,
        interval,
        one[:, None, places, None],
        other[None, :, None, later],
    ]
    return np.asarray(costs.sum((2, 3)) / max(len(places), len(later)))
