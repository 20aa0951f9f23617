"""Assign notes to hands at the least cost, by beam search with any cost model.

The search steps through chords. A *way* assigns all notes up to some time to the hands; the
cheapest ways are kept. Time and memory grow with the number of onsets.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.music.fingering.ergonomic import OVERLAP, struck_together
from sb3_piano.music.hands import HANDS, Hand
from sb3_piano.music.note import Note

_BEAM = 32
"""Width of the beam: ways that are kept at a time."""


@dataclass(frozen=True, eq=False, slots=True)
class Chord:
    """Notes struck together, and the notes that already sound."""

    onset: float
    """Time of the first strike, s."""
    struck: list[Note]
    """In order of pitch."""
    held: list[Note]
    left_takes: BoolArray
    """(options, struck) the notes that the left hand strikes."""
    left_holds: BoolArray
    """(ways, held) the notes that it holds."""


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """The keys that a hand, 0 (right) or 1 (left), strikes and holds in each way and option.

    The left hand's places are mirrored, so that the thumb's side is the low one in both parts.
    """

    hand: int
    sign: float
    chord: Chord
    takes: BoolArray
    """(options, struck) the notes that it strikes."""
    low: FloatArray
    """(options,) the lowest place that it strikes, 0 without one."""
    high: FloatArray
    """(options,) the highest one."""
    whole: FloatArray
    """(ways, options) the width of all keys that it strikes and holds."""
    count: IntArray
    """(options,) number of notes that it strikes."""
    held: IntArray
    """(ways, 1) number of notes that it holds."""


class HandCosts(ABC):
    """Cost model of hands; ``size`` numbers, the *state*, describe a hand's past."""

    start: FloatArray
    """(size,) the initial state of a hand."""

    @abstractmethod
    def options(self, struck: Sequence[Note]) -> BoolArray:
        """List the assignments of a chord's notes: (options, struck), true for the left hand."""

    @abstractmethod
    def place(self, note: Note) -> float:
        """Return the position of a note's key, from the left."""

    @abstractmethod
    def cost_of(self, states: FloatArray, part: Part) -> tuple[FloatArray, FloatArray]:
        """Compute the cost of a hand's part and its new state; as in `costs`, for one hand."""

    def costs(self, states: FloatArray, chord: Chord) -> tuple[FloatArray, FloatArray]:
        """Compute the cost of a chord, (ways, options), and the new states of both hands.

        New states are (ways, options, 2, size); the old ``states`` are (ways, 2, size).
        """
        keys, held = (
            np.array([self.place(note) for note in notes], dtype=float)
            for notes in (chord.struck, chord.held)
        )
        cost = np.zeros((len(states), len(chord.left_takes)))
        after = np.repeat(states[:, None], len(chord.left_takes), axis=1)
        for hand, sign in ((0, 1.0), (1, -1.0)):
            takes, holds = (left == hand for left in (chord.left_takes, chord.left_holds))
            plays = takes.any(axis=1)
            low, high = np.where(plays, _extent(sign * keys, takes), 0.0)
            # Infinite if a hand holds nothing: its width is then that of the struck keys.
            held_low, held_high = (place[:, None] for place in _extent(sign * held, holds))
            whole = np.maximum(high, held_high) - np.minimum(low, held_low)
            counts = takes.sum(axis=1), holds.sum(axis=1, keepdims=True)
            added, now = self.cost_of(
                states, Part(hand, sign, chord, takes, low, high, whole, *counts)
            )
            cost += np.where(plays, added, 0.0)
            after[..., hand, :] = np.where(plays[:, None], now, after[..., hand, :])
        return cost, after


def search(notes: Sequence[Note], model: HandCosts) -> list[Hand]:
    """Find the hand of each note; notes are sorted by onset."""
    cost = np.zeros(1)
    states = np.tile(model.start, (1, 2, 1))
    left_holds = np.zeros((1, 0), dtype=bool)
    sounding: list[int] = []
    trail: list[tuple[list[int], BoolArray, IntArray, IntArray]] = []
    for together in struck_together(notes):
        group = sorted(together, key=lambda at: notes[at].pitch)
        onset = notes[together[0]].onset
        struck = [notes[index] for index in group]
        # A key that is struck again is no longer held, whichever note it was.
        again = {note.pitch for note in struck}
        held = [notes[index] for index in sounding]
        stays = np.array([n.offset > onset + OVERLAP and n.pitch not in again for n in held], bool)
        sounding = [index for index, stay in zip(sounding, stays, strict=True) if stay]
        held = [notes[index] for index in sounding]
        options = model.options(struck)
        chord = Chord(onset, struck, held, options, left_holds[:, stays])
        added, after = model.costs(states, chord)
        total = cost[:, None] + added
        order = total.argsort(axis=None, kind="stable")[: 2 * _BEAM]
        way, option = np.unravel_index(order, total.shape)
        lasting = _last_of_each_key(group, notes)
        left_holds = np.concatenate([chord.left_holds[way], options[option][:, lasting]], axis=1)
        # Ways with equal states cost the same from here on: keep the cheapest.
        rows = np.column_stack([after[way, option].reshape(len(way), -1), left_holds])
        kept = _first_of_equals(rows)[:_BEAM]
        way, option, left_holds = way[kept], option[kept], left_holds[kept]
        cost, states = total[way, option], after[way, option]
        trail.append((group, options, way, option))
        sounding += [group[place] for place in lasting]
    found: list[Hand] = ["right"] * len(notes)
    best = int(cost.argmin())
    for group, options, ways, chosen in reversed(trail):
        for index, left in zip(group, options[chosen[best]], strict=True):
            found[index] = HANDS[int(left)]
        best = int(ways[best])
    return found


def _last_of_each_key(group: Sequence[int], notes: Sequence[Note]) -> list[int]:
    """Return the indices of the notes that hold a chord's keys: the longest one of each key."""
    by_end = sorted(range(len(group)), key=lambda place: notes[group[place]].offset)
    return sorted({notes[group[place]].pitch: place for place in by_end}.values())


def _first_of_equals(rows: FloatArray) -> list[int]:
    """Return the first index of each different row."""
    places: dict[bytes, int] = {}
    for place, row in enumerate(rows + 0.0):  # turns -0 into 0
        places.setdefault(row.tobytes(), place)
    return list(places.values())


def lowest_left(struck: Sequence[Note]) -> BoolArray:
    """List the options in which the left hand takes the lowest notes: (options, struck).

    One hand strikes a key, also if several notes share it.
    """
    firsts = np.unique([note.pitch for note in struck], return_index=True)[1]
    return np.arange(len(struck))[None, :] < np.append(firsts, len(struck))[:, None]


def _extent(places: FloatArray, chosen: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest chosen place of each row; inf and -inf without one."""
    low = np.where(chosen, places, np.inf).min(1, initial=np.inf)
    high = np.where(chosen, places, -np.inf).max(1, initial=-np.inf)
    return low, high
