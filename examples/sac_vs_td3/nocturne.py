"""The opening of Chopin's Nocturne op. 9 no. 2 in E flat major, with fingers and pedal.

    python examples/sac_vs_td3/nocturne.py   # writes nocturne.mid beside this file

These are the upbeat and bars 1 to 4, the whole first phrase. Source: the first edition of
M. Schlesinger (Paris, 1833), which is in the public domain; that of F. Kistner (Leipzig, 1832-33)
differs in these bars by misprints alone. The pedal is theirs too: down with each bass note and up
with the second chord, in bar 4 down from the third bass note to the end. The fingering is ours.

Simplified: the tempo is steady, 132 eighth notes a minute as in later editions (the first ones
print quarter notes); all notes are equally loud; the turn over the C of bar 2 is left out; the
bass notes, which have dots in bar 1, are short in all bars.

It is not what the paper trained on. Their "Nocturne Rousseau" comes with RoboPianist: part of a
performance by the YouTube channel Rousseau, with other times and fingers, which the channel lets
that benchmark use. For that reason alone the returns differ from the paper's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import pretty_midi

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Note, Pedal, PianoRoll, Score, write_midi

FILE = Path(__file__).with_suffix(".mid")

EIGHTH = 60.0 / 132.0
"""Length of an eighth note, s."""

RELEASE = {"right": 0.05, "left": 0.1}
"""How long before its end a note is let go, s. For the right hand it is one control step, so that
at this tempo it never has to hold two keys. The left hand leaps, and strikes keys again.
"""

DOTTED = 0.5
"""The part of its length for which a note with a dot is held."""


class Bar(NamedTuple):
    """What both hands play in a bar, as text.

    Notes stand one after the other, and each looks like ``F5/4*3``: the pitch, the finger (1 thumb
    to 5 little) and the length in eighths, 1 if left out. A chord is ``G3+Eb4/52``, and ``-*3`` a
    rest. ``'`` after the fingers is a dot. What follows ``#`` in a line is not read.
    """

    name: str
    right: str
    left: str
    length: int = 12
    """In eighths."""
    pedal: tuple[tuple[int, int], ...] = ((0, 2), (3, 5), (6, 8), (9, 11))
    """When the pedal goes down and up, in eighths from the beginning of the bar."""


# Left hand: a beat, a bass note and two chords, a line.
OPENING = (
    Bar("upbeat", right="Bb4/1", left="-", length=1, pedal=()),
    Bar(
        "bar 1",
        right="G5/5*4 F5/4 G5/5 F5/4*3 Eb5/3*2 Bb4/1",
        left="""
        Eb2/5' G3+Eb4/52 Bb3+Eb4+G4/421  # E flat major
        Eb3/5' Ab3+D4/52 Cb4+D4+Ab4/321  # D diminished 7th, over E flat
        Eb2/5' G3+Eb4/52 Bb3+Eb4+G4/421  # E flat major
        D2/5'  G3+Eb4/52 Bb3+Eb4+G4/421  # the same, over a passing D
        """,
    ),
    Bar(
        "bar 2",
        right="G5/5*2 C5/1 C6/5*2 G5/2 Bb5/4*3 Ab5/3*2 G5/2",
        left="""
        C2/5'  G3+E4/52  Bb3+E4+G4/421   # C 7th
        C3/5'  G3+E4/52  C4+E4+Bb4/421   # C 7th
        F2/5'  F3+Db4/52 Bb3+Db4+E4/321  # E diminished 7th, over F
        F2/5'  F3+C4/52  Ab3+C4+F4/421   # F minor
        """,
    ),
    Bar(
        "bar 3",
        right="F5/1*3 G5/3*2 D5/1 Eb5/3*3 C5/2*3",
        left="""
        Bb2/5' F3+D4/52   Bb3+D4+Ab4/321  # B flat 7th
        B2/5'  G3+F4/51   D4+F4+G4/321    # G 7th, over B
        C3/5'  G3+Eb4/52  C4+Eb4+G4/321   # C minor
        A2/5'  Gb3+Eb4/52 C4+Eb4+Gb4/321  # A diminished 7th
        """,
    ),
    Bar(
        "bar 4",
        right="""
        Bb4/1 D6/5 C6/4
        Bb5/3*0.5 Ab5/2*0.5 G5/1*0.5 Ab5/2*0.5 C5/1*0.5 D5/2*0.5
        Eb5/3*3 -*3
        """,
        left="""
        Bb2/5' F3+Eb4/51 Bb3+Eb4+Ab4/421  # B flat 7th, suspended
        Bb1/5' F3+D4/52  Bb3+Ab4/41       # B flat 7th
        Eb2/5' G3+Eb4/52 Bb3+Eb4+G4/421  # E flat major
        Eb3/5' G3+Eb4/52 Bb3+Eb4+G4/421  # E flat major
        """,
        pedal=((0, 2), (3, 5), (6, 12)),
    ),
)


def build(bars: Iterable[Bar] = OPENING) -> Score:
    """Return the score of the bars, played one after the other.

    Raises:
        ScoreError: If a note cannot be read, or a bar does not add up.
    """
    notes: list[Note] = []
    pedals: list[Pedal] = []
    start = 0  # of the bar, in eighths
    for bar in bars:
        notes += [*_notes(bar, "right", start), *_notes(bar, "left", start)]
        pedals += [
            Pedal(onset=(start + down) * EIGHTH, offset=(start + up) * EIGHTH)
            for down, up in bar.pedal
        ]
        start += bar.length
    return Score(notes=notes, pedals=pedals, title=FILE.stem)


def main() -> None:
    """Write the MIDI file and say what is in it."""
    score = build()
    write_midi(score, FILE)
    low, high = score.pitch_range
    steps = len(PianoRoll.from_score(score, 0.05))
    print(
        f"{FILE.name}: {len(score.notes)} notes in {score.duration:.2f} s, pitches {low} to {high} "
        f"({high - low + 1} keys), {steps} control steps of 0.05 s"
    )


_TOKEN = re.compile(
    r"""(?: - | (?P<pitches> [A-G]b?\d (?: \+ [A-G]b?\d)* ) / (?P<fingers> [1-5]+ ) (?P<dot> '?) )
    (?: \* (?P<length> \d+ (?: \.\d+ )? ) )?""",
    re.VERBOSE,
)


def _notes(bar: Bar, hand: str, start: int) -> Iterator[Note]:
    """Yield what one hand plays in a bar that starts after `start` eighths."""
    at = float(start)
    for token in _tokens(getattr(bar, hand)):
        where = f"{bar.name}, {hand} hand: {token!r}"
        match = _TOKEN.fullmatch(token)
        if match is None:
            raise ScoreError(f"{where} is no note: expected one such as F5/4, G3+Eb4/52*2 or -*3.")
        length = float(match["length"] or 1)
        if match["pitches"]:
            held = length * DOTTED * EIGHTH if match["dot"] else length * EIGHTH - RELEASE[hand]
            for pitch, finger in _touches(match["pitches"], match["fingers"], hand, where):
                onset = at * EIGHTH
                yield Note(onset=onset, offset=onset + held, pitch=pitch, finger=finger)
        at += length
    if at != start + bar.length:
        raise ScoreError(
            f"{bar.name}, {hand} hand: its notes and rests add up to {at - start:g} eighths: "
            f"expected {bar.length}."
        )


def _tokens(text: str) -> list[str]:
    return [token for line in text.splitlines() for token in line.partition("#")[0].split()]


def _touches(pitches: str, fingers: str, hand: str, where: str) -> list[tuple[int, int]]:
    """Return the MIDI pitches of a chord and the fingers 0-9 on them."""
    names = pitches.split("+")
    if len(names) != len(fingers):
        raise ScoreError(
            f"{where} has {len(fingers)} fingers: expected one for each of its {len(names)} notes."
        )
    first = 0 if hand == "right" else 5
    return [
        (pretty_midi.note_name_to_number(name), int(finger) - 1 + first)
        for name, finger in zip(names, fingers, strict=True)
    ]


if __name__ == "__main__":
    main()
