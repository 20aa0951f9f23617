"""The 12 major, natural minor and harmonic minor scales, the chromatic scale, and arpeggios.

Both hands play one octave up and down in quarter notes at 80 a minute. The 12 major scales are from
RoboVirtuoso (section 4), which gives neither register nor fingers. The register is from
RoboPianist's scales: the right hand starts between C5 and B5, the left two octaves below. Notes and
fingers are in ``scales.yml``, with reasons where manuals differ.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sb3_piano.files import read_table
from sb3_piano.music.hands import HANDS, Hand
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.music.studies.building import (
    checked_options,
    in_octaves,
    in_sequence,
    option_meanings,
)

_FIRST_C: Mapping[Hand, int] = MappingProxyType({"right": 72, "left": 48})
"""MIDI pitch of each hand's reference C: C5 and C3, as in RoboPianist's scales.

The hands are two octaves apart, so that the simulated forearms have room.
"""

_TEMPO = 80
_BEATS_PER_BAR = 4


def up_and_down(
    *,
    name: str,
    tonic: int,
    steps: Sequence[int],
    fingers: Sequence[str],
    tempo: Any = _TEMPO,
    hands: Any = "both",
    repeats: Any = 1,
    octaves: Any = 1,
) -> Score:
    """Make a study of notes up the keyboard in quarter notes of 4/4, and down again.

    ``tonic`` is the first note in semitones above C, 0-11; ``steps`` are the semitones of one
    octave above it. ``fingers`` are the pianists' numbers of the right and the left hand for two
    octaves up, one digit a note, as charts print them; further octaves repeat the second. Each
    repeat begins with a new bar. :func:`option_meanings` describes the other options.

    Raises:
        ConfigError: If a value is not valid, or the octaves do not fit on the keyboard.
    """
    seconds, players, times = checked_options(tempo, hands, repeats)

    def way(span: int) -> list[tuple[int, dict[Hand, int]]]:
        size = len(steps)
        intervals = [12 * octave + step for octave in range(span) for step in steps]
        digits = [two[:size] + two[size : 2 * size] * (span - 1) + two[-1] for two in fingers]
        numbers = [
            dict(zip(HANDS, map(int, pair), strict=True)) for pair in zip(*digits, strict=True)
        ]
        up = list(zip([*intervals, 12 * span], numbers, strict=True))
        return up + up[-2::-1]

    first = {hand: _FIRST_C[hand] + tonic for hand in players}
    presses = in_octaves(way, octaves, first)
    presses += [()] * (-len(presses) % _BEATS_PER_BAR)
    bars = range(0, times * len(presses), _BEATS_PER_BAR)
    return in_sequence([(together, seconds) for together in presses * times], name, bars=bars)


def _pieces() -> Iterator[Piece]:
    for kind in read_table(Path(__file__).with_suffix(".yml")):
        for tonic, (key, fingers) in enumerate(kind["fingers"].items()):
            name = kind["name"].format(key=key)
            spoken = key[0] + key[1:].replace("Sharp", " sharp").replace("b", " flat")
            yield Piece(
                name=name,
                title=kind["title"].format(key=spoken),
                collection=name.partition("-")[0],
                source=kind["source"],
                fingering="standard",
                build=partial(
                    up_and_down, name=name, tonic=tonic, steps=kind["steps"], fingers=fingers
                ),
                options=option_meanings(tempo=_TEMPO, octaves=1),
            )


_PIECES = list(_pieces())

SCALES, ARPEGGIOS = (
    MappingProxyType({piece.name: piece for piece in _PIECES if piece.collection == collection})
    for collection in ("scale", "arpeggio")
)
"""The pieces by name: ``scale-CMajor``, ``scale-ANaturalMinor``, ``arpeggio-CSharpMinor``..."""
