"""The built-in repertoire: public-domain music with finger labels, each piece a MIDI file."""

from __future__ import annotations

from pathlib import Path

from sb3_piano.music.midi_pieces import midi_pieces

REPERTOIRE = midi_pieces(Path(__file__).parent)
"""The pieces by name: one for each entry of ``pieces.yml`` and each MIDI file beside it."""

__all__ = ["REPERTOIRE"]
