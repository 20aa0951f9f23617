"""Scores of a few notes."""

from sb3_piano.music import Note, Pedal, Score


def note_of(onset, offset, pitch=60, label=-1, **fields):
    """Return a note whose finger or hand, if one is known, is its label."""
    name = "finger" if isinstance(label, int) else "hand"
    return Note(onset=onset, offset=offset, pitch=pitch, **{name: label, **fields})


def score_of(*notes, pedals=(), **fields):
    """Return the score of notes (onset, offset, pitch), or with a label, and of a pedal's presses.

    Args:
        notes: What :func:`note_of` is called with.
        pedals: Pairs (onset, offset).
        fields: Title, and bars.
    """
    presses = [Pedal(onset=onset, offset=offset) for onset, offset in pedals]
    return Score(notes=[note_of(*note) for note in notes], pedals=presses, **fields)
