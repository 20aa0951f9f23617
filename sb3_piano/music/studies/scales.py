"""The 12 major, natural minor and harmonic minor scales, and the chromatic scale.

Both hands play one octave up and down in quarter notes at 80 a minute: the 12 major scales are
those of RoboVirtuoso (section 4), which names neither the register nor the fingers. The register
is that of RoboPianist's scales: the right hand starts between C5 and B5, the left two octaves
below.

Fingering: the standard one. The digits are those that teachers' charts print, such as the "Scale
and Arpeggio Fingering Chart for Piano" of the Bellingham Music Teachers Association and the scale
charts of pianoscales.org. Where these leave a choice, the thumbs decide: they stay off the black
keys and take the first white key of each group of neighbouring white keys (right hand) or the last
(left hand), as the scale fingerings of the University of Evansville put it:

- B flat major, right hand: starts with 2 (2-1-2-3-1-2-3-4), as most manuals print it; 4 is the
  finger of every other B flat, and some start with it, too.
- C, F and G sharp minor, right hand: start 3-4-1, as they go on in the next octave; some charts
  print 2-3-1.
- G sharp natural minor, left hand: 3-2-1-3-2-1-4-3. The 3-2-1-4-3-2-1-3 of some charts belongs to
  the harmonic scale, and puts the thumb on F sharp here.
- E flat minor, left hand, and B flat harmonic minor: as printed, which are Evansville's exceptions.
- Chromatic: 3 on black keys, 1 on white ones; of two neighbouring white keys the second (right
  hand) or the first (left hand) takes 2. The right hand starts with 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from sb3_piano.music.piece import Piece
from sb3_piano.music.studies.keys import MAJOR_KEYS, MAJOR_SCALE, MINOR_KEYS, spoken
from sb3_piano.music.studies.run import Run, run_piece

_NATURAL_MINOR = (0, 2, 3, 5, 7, 8, 10)
_HARMONIC_MINOR = (0, 2, 3, 5, 7, 8, 11)
_CHROMATIC = tuple(range(12))

# Right hand, left hand, two octaves up each.
_C_MAJOR = ("123123412312345", "543213214321321")
_F_MAJOR = ("123412312341234", "543213214321321")
_B_MAJOR = ("123123412312345", "432143213214321")
_F_SHARP_MINOR = ("341231234123123", "432132143213214")
_C_SHARP_MINOR = ("341231234123123", "321432132143213")
_E_FLAT_MINOR = ("312341231234123", "214321321432132")
_B_FLAT_MINOR = ("212312341231234", "213214321321432")
_CHROMATIC_FINGERS = ("1313123131312313123131312", "1313213131321313213131321")

_MAJOR = {
    "C": _C_MAJOR,
    "Db": ("231234123123412", "321432132143213"),
    "D": _C_MAJOR,
    "Eb": ("312341231234123", "321432132143213"),
    "E": _C_MAJOR,
    "F": _F_MAJOR,
    "Gb": ("234123123412312", "432132143213214"),
    "G": _C_MAJOR,
    "Ab": ("341231234123123", "321432132143213"),
    "A": _C_MAJOR,
    "Bb": ("212312341231234", "321432132143213"),
    "B": _B_MAJOR,
}

_HARMONIC = {
    "C": _C_MAJOR,
    "CSharp": _C_SHARP_MINOR,
    "D": _C_MAJOR,
    "Eb": _E_FLAT_MINOR,
    "E": _C_MAJOR,
    "F": _F_MAJOR,
    "FSharp": _F_SHARP_MINOR,
    "G": _C_MAJOR,
    "GSharp": _C_SHARP_MINOR,
    "A": _C_MAJOR,
    "Bb": _B_FLAT_MINOR,
    "B": _B_MAJOR,
}

_NATURAL = {**_HARMONIC, "GSharp": ("341231234123123", "321321432132143")}


def _pieces() -> Iterator[Piece]:
    for key, tonic in MAJOR_KEYS.items():
        source = "generated, as in RoboVirtuoso"
        yield _scale(f"{key}Major", f"{spoken(key)} major", tonic, MAJOR_SCALE, _MAJOR[key], source)
    for key, tonic in MINOR_KEYS.items():
        title = f"{spoken(key)} natural minor"
        yield _scale(f"{key}NaturalMinor", title, tonic, _NATURAL_MINOR, _NATURAL[key])
    for key, tonic in MINOR_KEYS.items():
        title = f"{spoken(key)} harmonic minor"
        yield _scale(f"{key}HarmonicMinor", title, tonic, _HARMONIC_MINOR, _HARMONIC[key])
    yield _scale("Chromatic", "Chromatic", 0, _CHROMATIC, _CHROMATIC_FINGERS)


def _scale(
    name: str,
    title: str,
    tonic: int,
    steps: tuple[int, ...],
    fingers: tuple[str, str],
    source: str = "generated",
) -> Piece:
    right, left = fingers
    return run_piece(
        Run(
            name=f"scale-{name}",
            tonic=tonic,
            steps=steps,
            fingers={"right": right, "left": left},
        ),
        title=f"{title} scale",
        collection="scale",
        source=source,
    )


SCALES: Mapping[str, Piece] = MappingProxyType({piece.name: piece for piece in _pieces()})
"""The scales by name: ``scale-CMajor``, ``scale-ANaturalMinor``, ``scale-Chromatic``..."""
