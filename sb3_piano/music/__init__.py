"""Music: scores, piano rolls, files, pieces."""

from sb3_piano.music.catalogue import BUILT_IN, find_piece, is_path, load_score, pieces, shown_title
from sb3_piano.music.constants import (
    DEFAULT_VELOCITY,
    FINGER_NAMES,
    MAX_PITCH,
    MIN_PITCH,
    NUM_FINGERS,
    NUM_KEYS,
    UNKNOWN_FINGER,
)
from sb3_piano.music.formats import (
    read_midi,
    read_musicxml,
    read_pig,
    read_score,
    write_midi,
    write_musicxml,
    write_pig,
    write_score,
)
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.piece import Piece
from sb3_piano.music.roll import PianoRoll
from sb3_piano.music.score import Score, digest
from sb3_piano.music.selection import select_pieces
from sb3_piano.music.studies import STUDIES, major_scale
from sb3_piano.music.synthesis import SAMPLE_RATE, synthesize, write_wav

__all__ = [
    "BUILT_IN",
    "DEFAULT_VELOCITY",
    "FINGER_NAMES",
    "MAX_PITCH",
    "MIN_PITCH",
    "NUM_FINGERS",
    "NUM_KEYS",
    "SAMPLE_RATE",
    "STUDIES",
    "UNKNOWN_FINGER",
    "Note",
    "Pedal",
    "PianoRoll",
    "Piece",
    "Score",
    "digest",
    "find_piece",
    "is_path",
    "load_score",
    "major_scale",
    "pieces",
    "read_midi",
    "read_musicxml",
    "read_pig",
    "read_score",
    "select_pieces",
    "shown_title",
    "synthesize",
    "write_midi",
    "write_musicxml",
    "write_pig",
    "write_score",
    "write_wav",
]
