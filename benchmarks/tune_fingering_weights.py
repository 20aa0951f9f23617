"""Tunes the weights of the fingering search on generated studies, whose fingers are standard.

    python benchmarks/tune_fingering_weights.py --seconds 600

Changes a few weights at a time by chance and keeps what finds more of the studies' fingers again,
as long as weights stay near those of the literature. The studies are the scales, arpeggios and
Hanon's exercises of the package, and the patterns below, with the fingers that teachers give them.
The repertoire takes no part: agreement with its labels, printed at the end, tells what the weights
are worth on music that they have not seen.
"""

from __future__ import annotations

import argparse
import math
import random
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from rich.console import Console

from sb3_piano.music import BUILT_IN, Note
from sb3_piano.music.fingering.cost import DEFAULT_WEIGHTS, FingeringWeights
from sb3_piano.music.fingering.ergonomic import finger_hand
from sb3_piano.music.hands import HANDS, Hand

SHARES = {"scale": 0.35, "arpeggio": 0.2, "hanon": 0.25, "pattern": 0.2}
"""How much each kind of study counts."""

FIXED = ("pace", "haste", "rest")
"""What studies of even notes cannot tell."""

LITERATURE = FingeringWeights(
    physical=0.5,
    stretch=2.0,
    span_thumb=1.0,
    span_fingers=2.0,
    impractical=10.0,
    position_count=1.0,
    position_size=1.0,
    place=0.3,
    place_later=0.1,
    same_finger=8.0,
    same_finger_size=2.0,
    other_finger=3.0,
    other_finger_later=1.0,
    leap=30.0,
    weak_four=1.0,
    weak_five=1.0,
    three_four_five=1.0,
    three_to_four=1.0,
    four_on_black=1.0,
    thumb_on_black=1.0,
    thumb_on_black_white=2.0,
    five_on_black=0.0,
    five_on_black_white=2.0,
    passing=1.0,
    passing_size=0.5,
    passing_on_black=3.0,
    chord_finger=0.5,
    chord_finger_size=0.5,
    chord_shift=0.5,
    chord=1.0,
)
"""The points of Parncutt et al. 1997, with guesses for what is ours."""

LOYALTY = 0.001
"""What a weight costs that is e times that of the literature, as a share of fingers."""

STARTS = (0, 1, 3, 6)
"""White keys above C on which the patterns start."""

Step = tuple[Sequence[int], str]
"""Keys struck together, as white keys above the first, and the numbers of their fingers."""

_FIVE: list[Step] = [([step], str(step + 1)) for step in (0, 1, 2, 3, 4, 3, 2, 1, 0)]
_TRIADS: list[Step] = [([0, 2, 4], "135"), ([2, 4, 7], "125"), ([4, 7, 9], "135")]
_THIRDS: list[Step] = [([step, step + 2], f"{step + 1}{step + 3}") for step in (0, 1, 2, 1, 0)]

PATTERNS: dict[Hand, list[tuple[list[Step], float]]] = {
    "right": [
        (_FIVE, 0.25),
        ([step for step in _FIVE for _ in range(2)], 0.35),
        (_THIRDS, 0.35),
        ([*_TRIADS, _TRIADS[1], _TRIADS[0]], 1.0),
        ([*_TRIADS, _TRIADS[1], _TRIADS[0]], 0.4),
        ([([0, 2, 4, 7], "1235")] * 2, 0.6),
        ([([2, 4, 7, 9], "1245")] * 2, 0.6),
        ([([4, 7, 9, 11], "1245")] * 2, 0.6),
        ([([0], "1"), ([2], "3"), ([4], "5"), ([2], "3")] * 3, 0.25),
        ([([step, step + 5], "15") for step in (0, 1, 2, 3, 4, 3, 2, 1, 0)], 0.35),
        ([([step, step + 7], "15") for step in (0, 1, 2, 3, 4, 3, 2, 1, 0)], 0.35),
    ],
    "left": [
        ([(keys, str(6 - int(digit))) for keys, digit in _FIVE], 0.25),
        ([(keys, str(6 - int(digit))) for keys, digit in _FIVE for _ in range(2)], 0.35),
        ([([step, step + 2], f"{5 - step}{3 - step}") for step in (0, 1, 2, 1, 0)], 0.35),
        ([([0, 2, 4], "531"), ([2, 4, 7], "531"), ([4, 7, 9], "521"), ([2, 4, 7], "531")], 1.0),
        ([([0, 2, 4, 7], "5421")] * 2, 0.6),
        ([([2, 4, 7, 9], "5421")] * 2, 0.6),
        ([([4, 7, 9, 11], "5321")] * 2, 0.6),
        ([([0], "5"), ([4], "1"), ([2], "3"), ([4], "1")] * 4, 0.2),
        ([([0], "5"), ([2], "3"), ([4], "1"), ([2], "3")] * 3, 0.25),
        ([([step, step + 5], "51") for step in (0, 1, 2, 3, 4, 3, 2, 1, 0)], 0.35),
        ([([step, step + 7], "51") for step in (0, 1, 2, 3, 4, 3, 2, 1, 0)], 0.35),
    ],
}
"""Five-finger patterns, thirds, chords, broken chords, sixths and octaves: keys and s per step."""

HELD: dict[Hand, list[tuple[Step, list[Step]]]] = {
    "right": [
        (([0], "1"), [([4], "5"), ([3], "4"), ([2], "3"), ([3], "4"), ([4], "5"), ([2], "3")]),
        (([4], "5"), [([0], "1"), ([1], "2"), ([2], "3"), ([3], "4"), ([2], "3"), ([1], "2")]),
        (([0], "1"), [([7], "5"), ([4], "3")] * 3),
    ],
    "left": [
        (([4], "1"), [([0], "5"), ([1], "4"), ([2], "3"), ([1], "4"), ([0], "5"), ([2], "3")]),
        (([0], "5"), [([4], "1"), ([3], "2"), ([2], "3"), ([1], "4"), ([2], "3"), ([3], "2")]),
        (([0], "5"), [([7], "1"), ([4], "2")] * 3),
    ],
}
"""A key that is held, and what the same hand plays meanwhile."""


@dataclass(frozen=True)
class Part:
    """The part of a hand in a study: its notes without fingers, and the fingers."""

    kind: str
    hand: Hand
    notes: tuple[Note, ...]
    fingers: tuple[int, ...]


def part(kind: str, hand: Hand, notes: Sequence[Note]) -> Part:
    """Take the fingers off labelled notes of a hand."""
    bare = tuple(replace(note, finger=-1, hand=hand) for note in notes)
    return Part(kind, hand, bare, tuple(note.finger % 5 for note in notes))


def parts(kind: str, name: str, **options: float) -> Iterator[Part]:
    """Yield the parts of a built-in piece."""
    notes = BUILT_IN[name].score(**options).notes
    for hand in HANDS:
        chosen = [note for note in notes if note.hand == hand]
        if chosen:
            yield part(kind, hand, chosen)


def struck(step: Step, start: int, hand: Hand, onset: float, length: float) -> list[Note]:
    """Return the labelled notes of one step of a pattern."""
    notes = []
    for white, digit in zip(*step, strict=True):
        octave, degree = divmod(start + white, 7)
        pitch = (60 if hand == "right" else 36) + 12 * octave + (0, 2, 4, 5, 7, 9, 11)[degree]
        finger = HANDS.index(hand) * 5 + int(digit) - 1
        notes.append(Note(onset=onset, offset=onset + length, pitch=pitch, finger=finger))
    return notes


def patterns() -> Iterator[Part]:
    """Yield the patterns on all their first keys."""
    for hand in HANDS:
        for start in STARTS:
            for steps, pace in PATTERNS[hand]:
                notes = [
                    note
                    for index, step in enumerate(steps)
                    for note in struck(step, start, hand, pace * index, pace)
                ]
                yield part("pattern", hand, notes)
            for held, steps in HELD[hand]:
                notes = struck(held, start, hand, 0.0, 0.3 * len(steps))
                for index, step in enumerate(steps):
                    notes += struck(step, start, hand, 0.3 * index, 0.3)
                notes.sort(key=lambda note: (note.onset, note.pitch))
                yield part("pattern", hand, notes)


def studies() -> Iterator[Part]:
    """Yield all that the weights are tuned on."""
    for name, piece in BUILT_IN.items():
        if piece.collection in ("scale", "arpeggio"):
            yield from parts(piece.collection, name, octaves=1, tempo=80)
            yield from parts(piece.collection, name, octaves=2, tempo=160)
        if piece.collection == "hanon":
            yield from parts("hanon", name, octaves=1, tempo=84)
    yield from patterns()


def agreement(chosen: Sequence[Part], weights: FingeringWeights) -> dict[str, float]:
    """Return the share of fingers found again, by kind."""
    same: dict[str, int] = {}
    notes: dict[str, int] = {}
    for entry in chosen:
        found = finger_hand(entry.notes, entry.hand, weights).fingers
        hits = sum(a == b for a, b in zip(found, entry.fingers, strict=True))
        same[entry.kind] = same.get(entry.kind, 0) + hits
        notes[entry.kind] = notes.get(entry.kind, 0) + len(found)
    return {kind: same[kind] / notes[kind] for kind in same}


def value(found: dict[str, float], weights: FingeringWeights) -> float:
    """Return what weights are worth: fingers found again, less the way from the literature."""
    distance = sum(
        abs(math.log((getattr(weights, name) + 0.1) / (getattr(LITERATURE, name) + 0.1)))
        for name in tuned()
    )
    return sum(SHARES[kind] * share for kind, share in found.items()) - LOYALTY * distance


def tuned() -> list[str]:
    """Return the names of the weights that are tuned."""
    return [entry.name for entry in fields(FingeringWeights) if entry.name not in FIXED]


def changed(weights: FingeringWeights, rng: random.Random) -> FingeringWeights:
    """Change one to three weights by chance."""
    changes: dict[str, Any] = {}
    for name in rng.sample(tuned(), rng.choice((1, 1, 2, 3))):
        old = getattr(weights, name)
        if name == "physical":
            changes[name] = min(max(old + rng.gauss(0, 0.25), 0.0), 1.0)
        else:
            changes[name] = round((old + 0.02) * math.exp(rng.gauss(0, 0.5)), 3)
    return replace(weights, **changes)


def main() -> None:
    """Tune, and print the weights and what they are worth."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=600.0, help="how long to tune")
    parser.add_argument("--seed", type=int, default=0, help="seed of the changes")
    arguments = parser.parse_args()
    console, rng, chosen = Console(), random.Random(arguments.seed), list(studies())
    best = DEFAULT_WEIGHTS
    worth = value(agreement(chosen, best), best)
    end = time.monotonic() + arguments.seconds
    while time.monotonic() < end:
        candidate = changed(best, rng)
        found = agreement(chosen, candidate)
        if value(found, candidate) > worth:
            best, worth = candidate, value(found, candidate)
            console.print(f"{worth:.4f}", {kind: round(share, 3) for kind, share in found.items()})
    console.print({name: getattr(best, name) for name in tuned()})
    unseen = [
        entry
        for name, piece in BUILT_IN.items()
        if piece.collection == "repertoire"
        for entry in parts("repertoire", name)
    ]
    for title, entries in (("studies", chosen), ("unseen", unseen)):
        shares = {kind: round(share, 3) for kind, share in agreement(entries, best).items()}
        console.print(title, shares)


if __name__ == "__main__":
    main()
