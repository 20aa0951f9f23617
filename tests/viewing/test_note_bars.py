"""Falling notes, and the part of the keyboard that views have in sight."""

import mujoco
import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.music import PianoRoll
from sb3_piano.simulation import compile_scene
from sb3_piano.viewing.moment import (
    FINGER_COLORS,
    MISSED_COLOR,
    PRESSED_COLOR,
    UNLABELLED_COLOR,
    Moment,
)
from sb3_piano.viewing.note_bars import Falling, NoteBars, draw_notes, finger_plates
from sb3_piano.viewing.performance_renderer import pose
from sb3_piano.viewing.stage import PANEL_FOOT, staged

SILENT = np.zeros(88, dtype=bool)
WHITE, BLACK = 39, 40  # C4 and C#4


def bars_over(*notes):
    return NoteBars.over(compile_scene(), PianoRoll.from_score(score_of(*notes), 0.05))


def foot(bar):
    return bar.centre[2] - bar.half[2]


def sounding(*keys):
    marked = SILENT.copy()
    marked[list(keys)] = True
    return marked


def test_a_note_comes_down_steadily_reaches_its_key_when_it_is_due_and_sinks_into_it():
    notes = bars_over((1.0, 1.5, 60, 1))
    key_y = compile_scene().key_boxes[0][WHITE, 1]
    heights, lengths = [], []
    for step in range(31):
        (bar,) = notes.at(step, SILENT) or (None,)
        if bar is None:
            break
        assert bar.centre[1] == key_y
        heights.append(foot(bar))
        lengths.append(bar.half[2])
    assert step == 30  # the steps 20 to 29 are the note's
    falls = -np.diff(heights[:21])
    np.testing.assert_allclose(falls, falls[0])
    assert falls[0] > 0
    assert heights[20] == pytest.approx(PANEL_FOOT, abs=0.002)
    np.testing.assert_allclose(heights[20:], heights[20])
    assert (np.diff(lengths[20:]) < 0).all()
    np.testing.assert_allclose(lengths[:20], lengths[0])


def test_a_note_too_far_ahead_is_not_there_yet():
    notes = bars_over((10.0, 10.5, 60))
    assert notes.at(0, SILENT) == []
    assert len(notes.at(190, SILENT)) == 1


def test_notes_keep_the_colours_of_their_fingers_with_a_rim_if_right_and_are_grey_if_missed():
    notes = bars_over((0.1, 0.5, 60, 7), (0.1, 0.5, 61))
    seen = [
        [(note.color, note.rim) for note in notes.falling(step, sounding(BLACK))] for step in (2, 3)
    ]
    # After two steps the third, the first of both notes, has not been played yet.
    assert seen[0] == [(FINGER_COLORS[7], None), (UNLABELLED_COLOR, None)]
    assert seen[1] == [(MISSED_COLOR, None), (UNLABELLED_COLOR, PRESSED_COLOR)]
    # Where nothing is judged, they keep their colours.
    assert [(note.color, note.rim) for note in notes.falling(3, None)] == seen[0]
    white, black = notes.at(2, SILENT)
    assert black.half[1] < white.half[1]
    _, rim, inner = notes.at(3, sounding(BLACK))
    assert (rim.color, inner.color) == (PRESSED_COLOR, UNLABELLED_COLOR)
    assert rim.half[1] > inner.half[1]


def test_a_note_is_drawn_above_its_key_and_moves_by_parts_of_a_pixel():
    place = np.linspace(5, 100, 88)
    rows = []
    for low in (0.5, 0.505):
        picture = np.zeros((40, 105, 3), dtype=np.uint8)
        note = Falling(key=WHITE, low=low, high=0.75, color=(1.0, 1.0, 1.0, 1.0))
        draw_notes(picture, [note], place, 100.0)
        columns = np.flatnonzero(picture.any(axis=(0, 2)))
        assert abs(columns.mean() - place[WHITE]) <= 1
        rows.append(picture.sum(axis=(1, 2)))
    (first,), _ = np.nonzero(rows[0] == rows[0].max())[:1], None
    assert 9 <= first[0] <= 11
    assert (rows[1] > 0).sum() == (rows[0] > 0).sum()
    assert 0 < rows[0].sum() - rows[1].sum() < rows[0].max(), "the lower edge is smooth"


def test_a_key_that_sounds_rightly_has_a_plate_in_the_colour_of_its_finger():
    stage = staged(compile_scene())
    data = mujoco.MjData(stage.model)
    qpos = stage.model.qpos0.copy()
    qpos[stage.key_qpos[WHITE]] = stage.key_max_angle[WHITE]
    pose(stage, data, qpos)
    due, fingers = np.array([WHITE, BLACK]), np.array([3, 1], dtype=np.int8)
    moment = Moment(qpos=qpos, step=1, due=due, fingers=fingers, sounding=sounding(WHITE, 50))
    (plate,) = finger_plates(stage, data, moment)
    assert plate.color == FINGER_COLORS[3]
    assert plate.turn[2] != 0, "it is tilted as the key"
    assert plate.half[1] < stage.model.geom_size[stage.key_geom[WHITE], 1]


def test_the_whole_piece_is_in_sight_and_a_view_that_follows_is_where_the_music_is():
    low, high = 20, 70
    notes = bars_over((0.0, 1.0, 21 + low), (11.0, 12.0, 21 + high))
    key_y = compile_scene().key_boxes[0][:, 1]
    assert notes.whole.middle == pytest.approx((key_y[low] + key_y[high]) / 2)
    assert notes.whole.width == pytest.approx(key_y[high] - key_y[low])
    followed = [notes.followed(step) for step in range(len(notes.roll) + 1)]
    assert followed[0].middle == pytest.approx(key_y[low], abs=0.06)
    assert followed[-1].middle == pytest.approx(key_y[high], abs=0.06)
    moves = np.abs(np.diff([stretch.middle for stretch in followed]))
    assert moves.max() < 0.025  # half a metre a second
    assert notes.followed(10**6) == followed[-1]


def test_a_piece_without_notes_has_the_whole_keyboard_in_sight():
    silent = np.zeros((20, 88))
    roll = PianoRoll(
        control_timestep=0.05, active=silent, finger=silent - 1, onset=silent, sustain=silent[:, 0]
    )
    notes = NoteBars.over(compile_scene(), roll)
    assert notes.at(3, SILENT) == []
    assert notes.whole.width > 1.19
    assert notes.followed(0).width > 1.19
