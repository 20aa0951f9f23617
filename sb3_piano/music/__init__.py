"""Music: scores, piano rolls, files, pieces."""

from sb3_piano.music.catalogue import BUILT_IN, find_piece, load_score, pieces
from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH
from sb3_piano.music.formats import read_score, write_midi, write_score
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.piece import Piece
from sb3_piano.music.roll import PianoRoll
from sb3_piano.music.score import Score
from sb3_piano.music.selection import select_pieces
from sb3_piano.music.synthesis import synthesize, write_wav

__all__ = [
    "BUILT_IN",
    "MAX_PITCH",
    "MIN_PITCH",
    "Note",
    "Pedal",
    "PianoRoll",
    "Piece",
    "Score",
    "find_piece",
    "load_score",
    "pieces",
    "read_score",
    "select_pieces",
    "synthesize",
    "write_midi",
    "write_score",
    "write_wav",
]
