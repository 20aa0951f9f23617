"""The 12 major, natural minor and harmonic minor scales, the chromatic scale, and arpeggios.

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

The arpeggios of the 12 major and 12 minor triads are played in the same way. Their fingering is
the standard one in root position, as charts print it: that of the Bellingham Music Teachers
Association (C to D flat major), and of St. Olaf College ("Keyboard Proficiency Requirements",
level III, appendix 2). In words:

- A white first note: 1-2-3 and 5 at the top (right hand), 5-4-2-1 (left hand); the left hand takes
  3 in place of 4 on the black third of D, E, A and B major.
- A black first note, a white third: thumbs on the third, 2-1-2-4 and 2-1-4-2. Some start the right
  hand with 4, as it goes on in the next octave.
- All black (G flat major, E flat minor): as if the keys were white.
- B flat major and B flat minor: thumbs on white keys, 2-1-2-4 and 3-2-1-3; 2-3-1-2 and 3-2-1-3.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from sb3_piano.music.hands import Hand
from sb3_piano.music.piece import Piece
from sb3_piano.music.studies.building import MAJOR_KEYS, MAJOR_SCALE, MINOR_KEYS, UpAndDown, spoken

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


_MAJOR_TRIAD = (0, 4, 7)
_MINOR_TRIAD = (0, 3, 7)

_WHITE = ("1231235", "5421421")
_WIDE = ("1231235", "5321321")
_BLACK = ("2124124", "2142142")

_MAJOR_ARPEGGIOS = {
    "C": _WHITE,
    "Db": _BLACK,
    "D": _WIDE,
    "Eb": _BLACK,
    "E": _WIDE,
    "F": _WHITE,
    "Gb": _WIDE,
    "G": _WHITE,
    "Ab": _BLACK,
    "A": _WIDE,
    "Bb": ("2124124", "3213213"),
    "B": _WIDE,
}

_MINOR_ARPEGGIOS = {
    "C": _WHITE,
    "CSharp": _BLACK,
    "D": _WHITE,
    "Eb": _WHITE,
    "E": _WHITE,
    "F": _WHITE,
    "FSharp": _BLACK,
    "G": _WHITE,
    "GSharp": _BLACK,
    "A": _WHITE,
    "Bb": ("2312312", "3213213"),
    "B": _WHITE,
}


def _study(name: str, tonic: int, steps: tuple[int, ...], fingers: tuple[str, str]) -> UpAndDown:
    right, left = fingers
    hands: dict[Hand, str] = {"right": right, "left": left}
    return UpAndDown(name=name, tonic=tonic, steps=steps, fingers=hands)


def _scales() -> Iterator[Piece]:
    for tonic, key in enumerate(MAJOR_KEYS):
        study = _study(f"scale-{key}Major", tonic, MAJOR_SCALE, _MAJOR[key])
        yield study.piece(f"{spoken(key)} major scale", "generated, as in RoboVirtuoso")
    for kind, steps, table in (
        ("Natural", _NATURAL_MINOR, _NATURAL),
        ("Harmonic", _HARMONIC_MINOR, _HARMONIC),
    ):
        for tonic, key in enumerate(MINOR_KEYS):
            study = _study(f"scale-{key}{kind}Minor", tonic, steps, table[key])
            yield study.piece(f"{spoken(key)} {kind.lower()} minor scale")
    yield _study("scale-Chromatic", 0, _CHROMATIC, _CHROMATIC_FINGERS).piece("Chromatic scale")


def _arpeggios() -> Iterator[Piece]:
    for mode, keys, triad, table in (
        ("Major", MAJOR_KEYS, _MAJOR_TRIAD, _MAJOR_ARPEGGIOS),
        ("Minor", MINOR_KEYS, _MINOR_TRIAD, _MINOR_ARPEGGIOS),
    ):
        for tonic, key in enumerate(keys):
            study = _study(f"arpeggio-{key}{mode}", tonic, triad, table[key])
            yield study.piece(f"{spoken(key)} {mode.lower()} arpeggio")


SCALES: Mapping[str, Piece] = MappingProxyType({piece.name: piece for piece in _scales()})
"""The scales by name: ``scale-CMajor``, ``scale-ANaturalMinor``, ``scale-Chromatic``..."""

ARPEGGIOS: Mapping[str, Piece] = MappingProxyType({piece.name: piece for piece in _arpeggios()})
"""The arpeggios by name: ``arpeggio-CMajor``, ``arpeggio-CSharpMinor``..."""
