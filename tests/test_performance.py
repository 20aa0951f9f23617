"""The record of what was played, and the scores that are made from it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.exceptions import RunError
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.music import PianoRoll
from sb3_piano.performance import Performance

STEP = 0.05
C4, D4 = 60 - 21, 62 - 21

DUE = score_of((0.0, 0.1, 60, 0), (0.12, 0.3, 62, 1), pedals=[(0.05, 0.2)], title="two notes")


def played(presses, steps=6, score=DUE, pedal=()):
    """Return a performance of (key, first step, step after, strike, release, finger)."""
    active, finger = np.zeros((steps, 88), dtype=bool), np.full((steps, 88), -1, dtype=np.int8)
    for key, first, end, *_, by in presses:
        active[first:end, key], finger[first:end, key] = True, by
    sustain = np.zeros(steps, dtype=bool)
    sustain[list(pedal)] = True
    return Performance(
        roll=PianoRoll.from_score(score, STEP),
        key_active=active,
        sustain=sustain,
        strike_time=np.array([press[3] for press in presses], dtype=float),
        strike_speed=np.array([1.0, 2.0, np.nan][: len(presses)]),
        release_time=np.array([press[4] for press in presses], dtype=float),
        press_finger=finger,
        title=score.title,
    )


def test_the_score_of_what_was_played_has_its_times_fingers_and_pedal():
    presses = [(C4, 0, 2, 0.035, 0.115, 0), (D4, 3, 5, 0.165, 0.26, 7)]
    score = played(presses, pedal=[1, 2, 4]).to_score()
    assert score.title == "two notes"
    found = [(note.pitch, note.onset, note.offset, note.finger) for note in score.notes]
    assert found == [(60, 0.035, 0.115, 0), (62, 0.165, 0.26, 7)]
    assert [note.velocity for note in score.notes] == [48, 73]
    spans = [(pedal.onset, pedal.offset) for pedal in score.pedals]
    assert spans == [pytest.approx((0.05, 0.15)), pytest.approx((0.2, 0.25))]
    for steps in (0, 6):  # of nothing played there is none
        assert played([], steps=steps).to_score() is None


def test_metrics_are_over_the_steps_that_were_played():
    """Both notes are struck in time; only the first one is due within the first two steps."""
    struck = [(C4, 0, 2, 0.03, 0.1, 0)]
    for steps, recall in ((2, 1.0), (6, 0.5)):
        metrics = played(struck, steps=steps).metrics()
        assert set(metrics) == set(EPISODE_METRICS) - {"normalized_return"}
        assert (metrics["onset_precision"], metrics["onset_recall"]) == (1.0, recall)
    assert metrics["onset_error_mean_ms"] == pytest.approx(30.0)
    assert metrics["finger_share_r1"] == 1.0
    for finger, agreement in ((0, 1.0), (3, 0.0)):  # with the labels of the notes that are due
        metrics = played([(C4, 0, 2, 0.03, 0.1, finger)], steps=2).metrics()
        assert metrics["fingering_agreement"] == agreement


def test_musicianship_counts_from_the_first_note_and_over_the_steps_that_were_played():
    """The pedal of the score is down from 0.05 to 0.2 s, on a stage with 0.2 s before the piece."""
    late = PianoRoll.from_score(DUE, STEP, initial_buffer_time=0.2)
    struck = [(C4, 4, 6, 0.22, 0.3, 0), (D4, 6, 8, 0.33, 0.4, 1)]
    both = replace(played(struck, steps=len(late), pedal=[5, 6, 7]), roll=late, score=DUE)
    found = both.musicianship()
    assert found["onset_error_mean_right_ms"] == pytest.approx(15.0)
    assert (found["note_offset_f1"], found["pedal_f1"]) == pytest.approx((0.5, 1.0))
    first = replace(played(struck[:1], steps=6), roll=late, score=DUE)
    assert first.musicianship()["note_offset_f1"] == 1.0
    assert all(map(math.isnan, replace(played([], steps=3), roll=late).musicianship(DUE).values()))


def test_without_its_score_musicianship_asks_for_it():
    piece = played([(C4, 0, 2, 0.03, 0.1, 0)])
    with pytest.raises(RunError, match="recorded without its score"):
        piece.musicianship()
    assert piece.musicianship(DUE)["onset_error_mean_right_ms"] == pytest.approx(30.0)
