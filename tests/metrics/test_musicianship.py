"""Musicianship: hand-worked cases of each number, and mir_eval on random performances."""

import math
import random

import mir_eval
import numpy as np
import pytest
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.metrics.musicianship import MUSICIANSHIP, musicianship
from sb3_piano.music import Note, Pedal, Score

tables = Tables(__file__)


def score(notes, pedals=()):
    """Return a score of (pitch, onset, offset, velocity), with "left" for the left hand."""
    made = [
        Note(pitch=pitch, onset=on, offset=off, velocity=loud, hand=hand[0] if hand else "right")
        for pitch, on, off, loud, *hand in notes
    ]
    return Score(notes=made, pedals=[Pedal(onset=on, offset=off) for on, off in pedals])


@tables("due, played, expected, why")
def test_hand_worked_cases(due, played, expected, why):
    found = musicianship(score(**due), score(**played))
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-9), why


@tables("due, played, undefined")
def test_numbers_without_a_value(due, played, undefined):
    found = musicianship(score(**due), played and score(**played))
    assert list(found) == list(MUSICIANSHIP)
    assert [name for name, value in found.items() if math.isnan(value)] == undefined


def test_a_perfect_copy_is_perfect():
    piece = score(
        [(60, 0, 1, 40), (64, 0, 1, 90), (62, 1, 2, 60), (65, 2, 3, 70), (48, 0, 3, 80, "left")],
        [(0.5, 1.5)],
    )
    found = musicianship(piece, piece)
    ones = [name for name in MUSICIANSHIP if "f1" in name or name.endswith("correlation")]
    assert [found[name] for name in (*ones, "duration_ratio")] == pytest.approx([1] * 8)
    zero = ("velocity_bias", "chord_spread_ms", "tempo_error", "legato_overlap_ms")
    assert [found[name] for name in zero] == pytest.approx([0] * 4, abs=1e-9)
    assert found["pedal_share"] == pytest.approx(1 / 3)


def test_a_metronome_that_is_two_per_cent_fast_has_that_error_of_tempo():
    due = score_of(*((i / 4, i / 4 + 0.2, 60 + i) for i in range(12)))
    played = due.warp(lambda time: time / 1.02)
    assert musicianship(due, played)["tempo_error"] == pytest.approx(1 - 1 / 1.02)


def drawn(rng, n=40):
    """Return notes on four keys, so far apart on each that their matching is clear."""
    notes, free = [], dict.fromkeys((60, 61, 62, 64), 0.0)
    for _ in range(n):
        pitch = rng.choice(list(free))
        onset = free[pitch] + rng.choice([0.11, 0.3])
        offset = onset + rng.choice([0.12, 0.25, 0.4])
        free[pitch] = offset
        notes.append((pitch, onset, offset, rng.randint(1, 127)))
    return notes


def varied(rng, notes):
    """Return most notes of a score, earlier or later, longer or shorter, louder or softer."""
    kept = [note for note in notes if rng.random() < 0.9]
    late = [rng.uniform(-0.054, 0.054) for _ in kept]
    return [
        (
            pitch,
            max(onset + by, 0.0),
            offset + by + rng.uniform(-0.05, 0.0),
            min(max(round(0.5 * loud + 30 + rng.gauss(0, 8)), 1), 127),
        )
        for (pitch, onset, offset, loud), by in zip(kept, late, strict=True)
    ]


@pytest.mark.parametrize("seed", range(20))
def test_f1_with_endings_and_velocity_equals_mir_eval(seed):
    rng = random.Random(seed)
    notes = drawn(rng)
    due, played = score(notes), score(varied(rng, notes) if seed % 2 else drawn(rng))
    found = musicianship(due, played)

    def told(piece, *, loud=True):
        times = np.array([(note.onset, note.offset) for note in piece.notes])
        pitches = mir_eval.util.midi_to_hz(np.array([note.pitch for note in piece.notes]))
        return (times, pitches, *([np.array([n.velocity for n in piece.notes])] if loud else []))

    def f1(module, offset_ratio, **loud):
        both = (*told(due, **loud), *told(played, **loud))
        return module.precision_recall_f1_overlap(*both, offset_ratio=offset_ratio)[2]

    endings = f1(mir_eval.transcription, 0.2, loud=False)
    assert found["note_offset_f1"] == pytest.approx(endings)
    assert found["note_velocity_f1"] == pytest.approx(f1(mir_eval.transcription_velocity, None))
    both = f1(mir_eval.transcription_velocity, 0.2)
    assert found["note_offset_velocity_f1"] == pytest.approx(both)
