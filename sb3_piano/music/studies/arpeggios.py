"""The arpeggios of the 12 major and 12 minor triads.

Both hands play one octave up and down in quarter notes at 80 a minute, in the register of the
scales: the right hand starts between C5 and B5, the left two octaves below.

Fingering: the standard one in root position, as charts print it: that of the Bellingham Music
Teachers Association ("Scale and Arpeggio Fingering Chart for Piano"; C to D flat major), and of
St. Olaf College ("Keyboard Proficiency Requirements", level III, appendix 2). In words:

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

from sb3_piano.music.piece import Piece
from sb3_piano.music.studies.keys import MAJOR_KEYS, MINOR_KEYS, spoken
from sb3_piano.music.studies.run import Run, run_piece

_MAJOR_TRIAD = (0, 4, 7)
_MINOR_TRIAD = (0, 3, 7)

# Right hand, left hand, two octaves up each.
_WHITE = ("1231235", "5421421")
_WHITE_WIDE = ("1231235", "5321321")
_BLACK = ("2124124", "2142142")

_MAJOR = {
    "C": _WHITE,
    "Db": _BLACK,
    "D": _WHITE_WIDE,
    "Eb": _BLACK,
    "E": _WHITE_WIDE,
    "F": _WHITE,
    "Gb": _WHITE_WIDE,
    "G": _WHITE,
    "Ab": _BLACK,
    "A": _WHITE_WIDE,
    "Bb": ("2124124", "3213213"),
    "B": _WHITE_WIDE,
}

_MINOR = {
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


def _pieces() -> Iterator[Piece]:
    for key, tonic in MAJOR_KEYS.items():
        yield _arpeggio(key, "Major", tonic, _MAJOR_TRIAD, _MAJOR[key])
    for key, tonic in MINOR_KEYS.items():
        yield _arpeggio(key, "Minor", tonic, _MINOR_TRIAD, _MINOR[key])


def _arpeggio(
    key: str, mode: str, tonic: int, steps: tuple[int, ...], fingers: tuple[str, str]
) -> Piece:
    right, left = fingers
    return run_piece(
        Run(
            name=f"arpeggio-{key}{mode}",
            tonic=tonic,
            steps=steps,
            fingers={"right": right, "left": left},
        ),
        title=f"{spoken(key)} {mode.lower()} arpeggio",
        collection="arpeggio",
        source="generated",
    )


ARPEGGIOS: Mapping[str, Piece] = MappingProxyType({piece.name: piece for piece in _pieces()})
"""The arpeggios by name: ``arpeggio-CMajor``, ``arpeggio-CSharpMinor``..."""
