"""Hands for a score: which hand plays a note when the file does not say."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sb3_piano.music.constants import FINGERS_PER_HAND
from sb3_piano.music.fingering.ergonomic import OVERLAP, TOGETHER, struck_together
from sb3_piano.music.hands import HANDS, Hand
from sb3_piano.music.note import Note
from sb3_piano.music.score import Score

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]


# What it costs to give notes to a hand. Widths and ways are in semitones.
_WIDTH = 0.1  # per semitone between the lowest and the highest key a hand strikes together
_COMFORTABLE, _WIDE = 12.0, 1.0  # width from which a semitone costs more, and how much
_HELD, _HELD_MOST = 0.3, 3.0  # per semitone and finger that held keys add; they can be let go of
_FINGER = 5.0  # for each key beyond five that a hand has to strike together
_ENTRY = 0.5  # for a hand that strikes for the first time
_WAY = 0.06  # per semitone that the middle of a hand moves
_REACH, _FAR = 9.0, 0.15  # way from which a semitone costs more, and how much
_CROSSING, _CROSSING_SIZE = 1.0, 0.2  # for keys beyond the other hand's last ones, and per semitone
_MEMORY = 1.0  # s after which a hand's last place matters 1/e as much for crossing
_CENTRE, _REGISTER = 60.0, 0.03  # per semitone of the right hand below this pitch, the left above
_SLOWEST, _FASTEST = 0.3, 2.0  # between these the time there is weighs the ways
_PACE = 0.25  # s since a hand last struck at which ways cost what is said here

_BEAM = 32
"""Ways to share the piece between the hands that are followed at a time."""


def assign_hands(score: Score) -> Score:
    """Return the score with a hand for each note.

    Hands that are known stay. The others are found by a beam search over the keys struck at a
    time: of these the left hand takes the lower ones, so that hands never cross within a chord,
    and it costs something for a hand to stretch, to travel, or to strike beyond the other hand.

    Args:
        score: The score; notes keep everything else.
    """
    if all(note.hand is not None for note in score.notes):
        return score
    hands = _split(score.notes)
    notes = [replace(note, hand=hand) for note, hand in zip(score.notes, hands, strict=True)]
    return replace(score, notes=tuple(notes))


@dataclass(slots=True)
class _Beam:
    """Ways to share the piece up to some time."""

    cost: Numbers
    """(ways,) what each has cost so far."""
    place: Numbers
    """(ways, 2) middle of what each hand struck last, MIDI pitch."""
    edge: Numbers
    """(ways, 2) its key that was nearest to the other hand."""
    struck: Numbers
    """(ways, 2) when that was, in s."""
    left_holds: Flags
    """(ways, sounding) which sounding notes are the left hand's."""


def _split(notes: tuple[Note, ...]) -> list[Hand]:
    """Return the hand of each note."""
    never = np.full((1, 2), -np.inf)
    beam = _Beam(np.zeros(1), np.zeros((1, 2)), np.zeros((1, 2)), never, np.zeros((1, 0), bool))
    sounding: list[int] = []
    trail: list[tuple[list[int], Flags, NDArray[np.intp], NDArray[np.intp]]] = []
    for chord in struck_together(notes):
        group = sorted(chord, key=lambda at: notes[at].pitch)
        onset = notes[group[0]].onset
        stays = np.array([notes[index].offset > onset + OVERLAP for index in sounding], dtype=bool)
        sounding = [index for index, stay in zip(sounding, stays, strict=True) if stay]
        beam.left_holds = beam.left_holds[:, stays]
        hands = np.array([notes[index].hand or "" for index in group])
        # Of what is struck together the left hand takes the lowest keys: (options, notes).
        lowest = np.arange(len(group))[None, :] < np.arange(len(group) + 1)[:, None]
        options = np.unique(np.where(hands == "", lowest, hands == "left"), axis=0)
        keys = np.array([notes[index].pitch for index in group], dtype=float)
        held = np.array([notes[index].pitch for index in sounding], dtype=float)
        beam, way, option = _advance(beam, keys, held, onset, options)
        trail.append((group, options, way, option))
        sounding += group
    found: list[Hand] = ["right"] * len(notes)
    best = int(beam.cost.argmin())
    for group, options, ways, chosen in reversed(trail):
        for index, left in zip(group, options[chosen[best]], strict=True):
            found[index] = HANDS[int(left)]
        best = int(ways[best])
    return found


def _advance(
    beam: _Beam, keys: Numbers, held: Numbers, onset: float, options: Flags
) -> tuple[_Beam, NDArray[np.intp], NDArray[np.intp]]:
    """Go on by the keys that are struck at a time, and keep the best ways.

    Returns:
        The ways, and for each from which one it comes and which option it takes.
    """
    cost = np.repeat(beam.cost[:, None], len(options), axis=1)
    middles, edges = np.zeros((2, 2, len(options)))
    plays = np.array([(~options).any(1), options.any(1)])  # right, left
    for hand, sign in ((0, 1.0), (1, -1.0)):
        # Seen from the right hand: the left hand's keys are turned upside down.
        takes, holds = (options, beam.left_holds) if hand else (~options, ~beam.left_holds)
        low, high = np.where(plays[hand], _extent(sign * keys, takes), 0.0)
        middles[hand], edges[hand] = sign * (low + high) / 2, sign * low
        wrong = np.maximum(sign * (_CENTRE - keys), 0)
        part = (
            _grip(low, high, takes.sum(1), sign * held, holds)
            + _way(beam, hand, middles[hand], onset)
            + _crossing(beam, 1 - hand, sign, low, onset)
            + _REGISTER * (takes * wrong).sum(1)
        )
        cost += np.where(plays[hand], part, 0.0)
    order = cost.argsort(axis=None, kind="stable")[: 2 * _BEAM]
    way, option = np.unravel_index(order, cost.shape)
    played = plays.T[option]
    place = np.where(played, middles.T[option], beam.place[way])
    left_holds = np.concatenate([beam.left_holds[way], options[option]], axis=1)
    # What will cost the same from here on need not be followed twice.
    rows = np.column_stack([place, left_holds])
    kept = np.sort(np.unique(rows, axis=0, return_index=True)[1])[:_BEAM]
    way, option, played = way[kept], option[kept], played[kept]
    edge = np.where(played, edges.T[option], beam.edge[way])
    struck = np.where(played, onset, beam.struck[way])
    after = _Beam(cost[way, option], place[kept], edge, struck, left_holds[kept])
    return after, way, option


def _grip(
    low: Numbers, high: Numbers, count: NDArray[np.int_], held: Numbers, holds: Flags
) -> Numbers:
    """Cost of striking and holding keys together: (ways, options)."""
    width = high - low
    strikes = _WIDTH * width + _WIDE * np.maximum(width - _COMFORTABLE, 0)
    strikes += _FINGER * np.maximum(count - FINGERS_PER_HAND, 0)
    if not held.size:
        return np.asarray(strikes[None, :])
    held_low, held_high = _extent(held, holds)
    # Infinite where a hand holds nothing, which is left out below.
    whole = np.maximum(high, held_high[:, None]) - np.minimum(low, held_low[:, None])
    added = np.maximum(whole, _COMFORTABLE) - np.maximum(width, _COMFORTABLE)
    fingers = np.maximum(count + holds.sum(1)[:, None] - FINGERS_PER_HAND, 0)
    cost = np.minimum(_HELD * added + _HELD * fingers, _HELD_MOST)
    return np.asarray(strikes + np.where(np.asarray(holds.any(1))[:, None], cost, 0.0))


def _way(beam: _Beam, hand: int, middle: Numbers, onset: float) -> Numbers:
    way = np.abs(middle - beam.place[:, hand, None])
    cost = _WAY * way + _FAR * np.maximum(way - _REACH, 0)
    time = np.maximum(onset - beam.struck[:, hand, None], TOGETHER)
    speed = np.clip(np.sqrt(_PACE / time), _SLOWEST, _FASTEST)
    return np.where(np.isfinite(time), speed * cost, _ENTRY)


def _crossing(beam: _Beam, other: int, sign: float, low: Numbers, onset: float) -> Numbers:
    depth = sign * beam.edge[:, other, None] - low
    fresh = np.exp(-(onset - beam.struck[:, other, None]) / _MEMORY)
    return np.where(depth >= 0, fresh * (_CROSSING + _CROSSING_SIZE * depth), 0.0)


def _extent(keys: Numbers, chosen: Flags) -> tuple[Numbers, Numbers]:
    """Return the lowest and the highest chosen key of each row; infinity and less if none is."""
    low = np.where(chosen, keys, np.inf).min(1, initial=np.inf)
    high = np.where(chosen, keys, -np.inf).max(1, initial=-np.inf)
    return low, high
