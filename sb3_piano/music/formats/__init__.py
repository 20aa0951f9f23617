"""File formats: what a score is read from and written to."""

from sb3_piano.music.formats.files import READERS, read_score
from sb3_piano.music.formats.midi import read_midi, write_midi
from sb3_piano.music.formats.pig import read_pig

__all__ = ["READERS", "read_midi", "read_pig", "read_score", "write_midi"]
