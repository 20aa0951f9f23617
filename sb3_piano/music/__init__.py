"""Music: scores, piano rolls, files and studies."""

from sb3_piano.music.constants import (
    DEFAULT_VELOCITY,
    FINGER_NAMES,
    MAX_PITCH,
    MIN_PITCH,
    NUM_FINGERS,
    NUM_KEYS,
    UNKNOWN_FINGER,
)
from sb3_piano.music.load import load_score
from sb3_piano.music.midi import read_midi, write_midi
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.pig import read_pig
from sb3_piano.music.roll import PianoRoll
from sb3_piano.music.score import Score
from sb3_piano.music.studies import STUDIES, major_scale, study
from sb3_piano.music.synthesis import SAMPLE_RATE, synthesize, write_wav

__all__ = [
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
    "Score",
    "load_score",
    "major_scale",
    "read_midi",
    "read_pig",
    "study",
    "synthesize",
    "write_midi",
    "write_wav",
]
