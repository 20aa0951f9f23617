"""MusicXML, the format of notation programs."""

from sb3_piano.music.formats.musicxml.read import read_musicxml
from sb3_piano.music.formats.musicxml.write import write_musicxml

__all__ = ["read_musicxml", "write_musicxml"]
