"""File formats: what a score is read from and written to."""

from sb3_piano.music.formats.files import READERS, WRITERS, read_score, write_score
from sb3_piano.music.formats.midi import read_midi, write_midi
from sb3_piano.music.formats.musicxml import read_musicxml, write_musicxml
from sb3_piano.music.formats.pig import read_pig, read_pig_annotations, write_pig

__all__ = [
    "READERS",
    "WRITERS",
    "read_midi",
    "read_musicxml",
    "read_pig",
    "read_pig_annotations",
    "read_score",
    "write_midi",
    "write_musicxml",
    "write_pig",
    "write_score",
]
