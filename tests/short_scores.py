"""Scores of a few notes."""

import numpy as np

from sb3_piano.music import Note, Pedal, Score, write_midi


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


def tune(first=60, finger=-1, n_notes=3):
    """Return notes of half a second, one after the other, some of them a whole tone higher."""
    notes = ((i * 0.5, i * 0.5 + 0.4, first + 2 * (i % 9), finger) for i in range(n_notes))
    return score_of(*notes)


def save_tune(path, first=60, **fields):
    """Write a tune as a MIDI file, and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_midi(tune(first, **fields), path)
    return path


def brute_force_goal(roll, finger, step, horizon):
    """Return key, onset and release of a finger's present or next note, read off the roll."""

    def key_at(t):
        keys = np.flatnonzero(roll.active[t] & (roll.finger[t] == finger))
        return int(keys[0]) if len(keys) else -1

    for onset in range(step, min(step + horizon + 1, len(roll))):
        if key_at(onset) >= 0:
            end = onset + 1
            while end < len(roll) and key_at(end) == key_at(onset):
                if roll.onset[end, key_at(end)]:
                    break
                end += 1
            return key_at(onset), onset - step, min(end - step, horizon)
    return -1, horizon, horizon
