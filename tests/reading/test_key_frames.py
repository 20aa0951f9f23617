"""Key frames: fingertips at the keys' surfaces, found by turning the keys in MuJoCo."""

import numpy as np
import pytest
from drawn_presses import hand_presses
from hand_parts import hand_of, keys_of, over_the_top, scene_of, sounding_share, turned_boxes
from hypothesis import given
from hypothesis import strategies as st

from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.music.fingering.leaps import TimedPress, time_presses
from sb3_piano.music.fingering.robot import KEY_SPACING
from sb3_piano.music.presses import Press
from sb3_piano.reading.key_frames import _REACH, key_frames

SCENE = scene_of()
KEYS = keys_of(SCENE)
RADIUS = hand_of(SCENE, 0).radius
WHITE = [key for key in range(88) if not KEY_IS_BLACK[key]]
BLACK = [key for key in range(88) if KEY_IS_BLACK[key]]
C4 = 39


def frames_of(timed, n_states=40, sign=1, **options):
    return key_frames(timed, sign, n_states, RADIUS, KEYS, **options)


def held(key, finger, first=20, last=24, leaps=False):
    return TimedPress(Press(key, finger, first, last), first, last, leaps)


def lowest_point(frames, state, finger):
    return frames.target[state, finger] - [0, 0, RADIUS[finger]]


KEYS_AND_FINGERS = [(key, finger) for key in (0, 1, C4, C4 + 1, 87) for finger in (0, 1, 4)]


@pytest.mark.parametrize(("key", "finger"), KEYS_AND_FINGERS)
@pytest.mark.parametrize("leaps", [True, False])
def test_a_key_is_let_down_far_enough_to_sound_in_all_its_states_and_no_other(key, finger, leaps):
    frames = frames_of([held(key, finger, leaps=leaps)])
    for state in range(40):
        if not frames.weight[state, finger].any():
            continue
        point = lowest_point(frames, state, finger)
        sounds = over_the_top(SCENE, point, key, sounding_share(SCENE, key)) < 0
        assert sounds == (20 <= state <= 24)
    assert frames.weight[18:26, finger].all()


@pytest.mark.parametrize(("key", "finger"), KEYS_AND_FINGERS)
def test_targets_are_on_the_free_part_of_the_right_key(key, finger):
    frames = frames_of([held(key, finger)])
    centre, _, half = turned_boxes(SCENE, 0.0)
    asked = frames.weight[:, finger].any(axis=1)
    target = frames.target[asked, finger]
    np.testing.assert_allclose(target[:, 1], centre[key, 1], atol=1e-9)
    assert (target[:, 0] < centre[key, 0] + half[key, 0]).all()
    front_of_black = (centre + half)[BLACK, 0].max()
    behind = target[:, 0] < front_of_black
    assert behind.all() if key in BLACK else not behind.any()


def test_a_hand_that_plays_black_keys_too_plays_white_ones_nearer_to_them():
    alone = frames_of([held(C4, 2)])
    mixed = frames_of([held(C4, 2), held(C4 + 3, 4)])
    assert mixed.target[20, 2, 0] < alone.target[20, 2, 0]
    front_of_black = (turned_boxes(SCENE, 0.0)[0] + turned_boxes(SCENE, 0.0)[2])[BLACK, 0].max()
    assert mixed.target[20, 2, 0] > front_of_black
    apart = frames_of([held(C4, 2, 5, 6), held(C4 + 3, 4, 30, 32)])
    assert apart.target[5, 2, 0] == alone.target[20, 2, 0]


@given(hand_presses(rests=2), st.sampled_from([1, -1]), st.booleans())
def test_a_key_that_is_held_is_never_left_for_another_one(presses, sign, leaping):
    if leaping:
        timed = time_presses(presses, sign)
    else:
        timed = [TimedPress(press, press.first, press.last) for press in presses]
    n_states = max(one.last for one in timed) + 3
    frames = frames_of(timed, n_states, sign)
    for one in timed:
        key, finger = one.press.key, one.press.finger
        for state in range(one.first, one.last + 1):
            assert frames.target[state, finger, 1] == KEYS.y[key]
            assert (frames.weight[state, finger] > 0).all()
            point = lowest_point(frames, state, finger)
            assert over_the_top(SCENE, point, key, sounding_share(SCENE, key)) < 0


def test_a_finger_moves_early_only_if_no_other_one_holds_the_hand_far_away():
    near = frames_of([held(WHITE[23], 0, 5, 19), held(WHITE[27], 4, 20, 24)])
    far = frames_of([held(WHITE[23], 0, 5, 19), held(WHITE[45], 4, 20, 24)])
    distance = KEYS.y[WHITE[45]] - KEYS.y[WHITE[23]] - 4 * KEY_SPACING
    assert distance > _REACH
    assert near.weight[16, 4].any()
    assert not far.weight[:19, 4].any()
    assert far.weight[19:25, 4].all()


def test_a_finger_goes_to_its_next_key_only_after_the_one_before():
    one, other = held(C4, 0, 8, 9), held(C4 + 2, 0, 13, 14)
    alone, both = frames_of([one]), frames_of([one, other])
    np.testing.assert_array_equal(both.target[:11, 0], alone.target[:11, 0])
    assert (both.target[11:15, 0, 1] > alone.target[9, 0, 1]).all()


@pytest.mark.parametrize("leapt", [False, True])
def test_with_dynamics_a_finger_strikes_from_as_far_as_its_note_is_loud(leapt):
    heights = []
    for velocity in (30, 60, 70, 80, 127):
        press = TimedPress(Press(C4, 1, 20, 24, velocity=velocity), 20, 24, leapt=leapt)
        as_usual, loud = frames_of([press]), frames_of([press], loudness_step=0.05)
        heights.append(lowest_point(loud, 19, 1)[2])
        others = np.arange(40) != 19
        np.testing.assert_array_equal(loud.target[others], as_usual.target[others])
    assert (np.diff(heights) >= 0).all()
    # A key at the speed of 60 makes 21.1 travels in a second: from its top down in 0.05 s.
    assert heights[1] == pytest.approx(KEYS.top[C4], abs=1e-4)
