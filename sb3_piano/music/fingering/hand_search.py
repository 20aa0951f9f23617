"""The search: which hand plays each note of a piece at the least cost, for any model of costs.

A beam search over what is struck together. A *way* shares all notes up to some time between the
hands; the cheapest are followed. Time and memory grow with the number of onsets.
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
"""Ways to share the piece between the hands that are followed at a time."""


@dataclass(frozen=True, eq=False, slots=True)
class Chord:
    """Notes that are struck together, and those that sound already."""

    onset: float
    """When the first is struck, s."""
    struck: list[Note]
    """In order of pitch."""
    held: list[Note]
    left_takes: BoolArray
    """(options, struck) which of these the left hand strikes."""
    left_holds: BoolArray
    """(ways, held) which of these it holds."""


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """What one hand, 0 (right) or 1 (left), strikes and holds in each way and option.

    The left hand's places are turned upside down: in both parts the thumb's side is the low one.
    """

    hand: int
    sign: float
    chord: Chord
    takes: BoolArray
    """(options, struck) which notes it strikes."""
    low: FloatArray
    """(options,) the least place that it strikes, 0 if none."""
    high: FloatArray
    """(options,) the greatest one."""
    whole: FloatArray
    """(ways, options) the width of what it strikes and holds."""
    count: IntArray
    """(options,) how many notes it strikes."""
    held: IntArray
    """(ways, 1) how many it holds."""


class HandCosts(ABC):
    """What hands cost. What has to be known of a hand's past is ``size`` numbers, its *state*."""

    start: FloatArray
    """(size,) the state of a hand that has not played yet."""

    @abstractmethod
    def options(self, struck: Sequence[Note]) -> BoolArray:
        """Return the ways to share notes that are struck together: (options, struck), if left."""

    @abstractmethod
    def place(self, note: Note) -> float:
        """Return where on the keyboard a note is, from the left."""

    @abstractmethod
    def cost_of(self, states: FloatArray, part: Part) -> tuple[FloatArray, FloatArray]:
        """Return what a hand's part costs, and its state then; as in `costs`, of one hand."""

    def costs(self, states: FloatArray, chord: Chord) -> tuple[FloatArray, FloatArray]:
        """Return what a chord costs, (ways, options), and the states of both hands then.

        These are (ways, options, 2, size); ``states`` before are (ways, 2, size).
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
            # Infinite where a hand holds nothing: then it is as wide as what it strikes.
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
    """Return the hand of each note; they are sorted by onset."""
    cost = np.zeros(1)
    states = np.tile(model.start, (1, 2, 1))
    left_holds = np.zeros((1, 0), dtype=bool)
    sounding: list[int] = []
    trail: list[tuple[list[int], BoolArray, IntArray, IntArray]] = []
    for together in struck_together(notes):
        group = sorted(together, key=lambda at: notes[at].pitch)
        onset = notes[together[0]].onset
        struck = [notes[index] for index in group]
        # A key that is struck again is held no longer, whatever note has begun on it.
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
        # What will cost the same from here on need not be followed twice.
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
    """Return the places of the notes of a chord that hold its keys: of several, the longest."""
    by_end = sorted(range(len(group)), key=lambda place: notes[group[place]].offset)
    return sorted({notes[group[place]].pitch: place for place in by_end}.values())


def _first_of_equals(rows: FloatArray) -> list[int]:
    """Return where each different row stands first."""
    places: dict[bytes, int] = {}
    for place, row in enumerate(rows + 0.0):  # which makes 0 of -0
        places.setdefault(row.tobytes(), place)
    return list(places.values())


def lowest_left(struck: Sequence[Note]) -> BoolArray:
    """Return the ways to share notes in which the left hand takes the lowest: (options, struck).

    A key is struck by one hand, however many notes strike it.
    """
    firsts = np.unique([note.pitch for note in struck], return_index=True)[1]
    return np.arange(len(struck))[None, :] < np.append(firsts, len(struck))[:, None]


def _extent(places: FloatArray, chosen: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the least and the greatest chosen place of each row; infinity and less if none is."""
    low = np.where(chosen, places, np.inf).min(1, initial=np.inf)
    high = np.where(chosen, places, -np.inf).max(1, initial=-np.inf)
    return low, high
