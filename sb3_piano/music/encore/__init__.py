"""Further public-domain pieces, each a MIDI file, which had no say in how anything was tuned."""

from __future__ import annotations

from pathlib import Path

from sb3_piano.music.midi_pieces import midi_pieces

ENCORE = midi_pieces(Path(__file__).parent)
"""The pieces by name: one for each entry of ``pieces.yml`` and each MIDI file beside it."""

__all__ = ["ENCORE"]
