"""MusicXML, the format of notation programs."""
