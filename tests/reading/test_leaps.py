"""Leaps: a hand that moves along the keys takes the time for it from the notes around."""

import pytest
from drawn_presses import hand_presses
from hypothesis import given
from hypothesis import strategies as st

from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.music.fingering import robot
from sb3_piano.music.fingering.leaps import time_presses
from sb3_piano.music.fingering.robot import hand_place
from sb3_piano.music.presses import Press

WHITE = [key for key in range(88) if not KEY_IS_BLACK[key]]
MIDDLE = 23  # of the white keys: C4

# Without end: whatever a leap costs, these notes can pay for it, and no rest does.
LONG = 60


def white_keys(*distances, sign=1, rest=0):
    """Return presses of one finger, each some white keys away from the middle one."""
    length = LONG + rest
    return [
        Press(WHITE[MIDDLE + sign * distance], 2, 1 + i * length, i * length + LONG)
        for i, distance in enumerate(distances)
    ]


def gap(presses, sign=1):
    """Return how many states lie between the first press and the second one, as they are timed."""
    first, second = time_presses(presses, sign)
    return second.first - first.last - 1


@given(hand_presses(), st.sampled_from([1, -1]))
def test_no_press_is_empty_and_none_is_longer_than_asked(presses, sign):
    timed = time_presses(presses, sign)
    assert [one.press for one in timed] == presses
    for one in timed:
        assert one.press.first <= one.first <= one.last <= one.press.last


def test_a_note_that_leaps_before_and_after_would_use_up_keeps_states_in_its_middle():
    far = WHITE[MIDDLE + 12]
    for last, kept in ((3, (2, 3)), (10, (4, 8)), (20, (8, 14))):
        presses = [
            Press(WHITE[MIDDLE], 2, 1, 1),
            Press(far, 2, 2, last),
            Press(WHITE[MIDDLE], 2, last + 1, last + 1),
        ]
        timed = time_presses(presses, 1)
        assert (timed[1].first, timed[1].last) == kept


def test_a_step_of_neighbouring_fingers_on_neighbouring_keys_is_free():
    presses = [Press(WHITE[MIDDLE + i], i, 1 + 5 * i, 5 + 5 * i) for i in range(5)]
    timed = time_presses(presses, 1)
    assert [(one.first, one.last) for one in timed] == [(p.first, p.last) for p in presses]
    assert not any(one.leaps for one in timed)


def test_a_finger_comes_up_before_it_takes_the_key_next_to_its_own():
    black = next(key for key in range(WHITE[MIDDLE], 88) if KEY_IS_BLACK[key])
    near = [Press(black - 1, 2, 1, 10), Press(black, 2, 11, 20)]
    places = [hand_place(press.key, press.finger, 1) for press in near]
    assert abs(places[0] - places[1]) < robot.LEAP_DISTANCE
    assert gap(near) == robot.LEAP_STEPS
    other_finger = [near[0], Press(black, 3, 11, 20)]
    assert gap(other_finger) == 0


@pytest.mark.parametrize(("rest", "repeated"), [(0, True), (1, True), (2, False)])
def test_a_finger_that_strikes_its_key_again_at_once_does_not_leave_it(rest, repeated):
    first, _ = time_presses(
        [Press(WHITE[MIDDLE], 2, 1, 10), Press(WHITE[MIDDLE], 2, 11 + rest, 20)], 1
    )
    assert first.repeated is repeated
    assert not first.leaps


@pytest.mark.parametrize(("length", "late"), [(LONG, 0), (3, 0), (2, 1), (1, 2)])
def test_a_leap_takes_from_the_note_before_all_but_a_state_then_from_the_next_strike(length, late):
    before = Press(WHITE[MIDDLE], 2, 1, length)
    after = Press(WHITE[MIDDLE + 2], 2, length + 1, length + LONG)
    first, second = time_presses([before, after], 1)
    assert second.first - after.first == late
    assert first.last == max(1, length - robot.LEAP_STEPS)


def test_far_leaps_cost_no_less_than_near_ones():
    gaps = [gap(white_keys(0, distance)) for distance in range(16)]
    assert gaps == sorted(gaps)
    assert gaps[0] == 0 < gaps[-1] == robot.LEAP_STEPS + len(robot.LEAP_MORE)
    assert gaps == [gap(white_keys(0, -distance)) for distance in range(16)]


def test_a_rest_pays_for_a_leap():
    gaps = [gap(white_keys(0, 7, rest=rest)) for rest in range(robot.LEAP_REST + 5)]
    # As long as the rest is too short it is filled up; after that, the notes have all their time.
    enough = gaps[0]
    assert gaps == [max(enough, rest) for rest in range(len(gaps))]


def test_notes_that_sound_together_are_one_place_however_far_apart():
    presses = [Press(WHITE[MIDDLE], 0, 1, 9), Press(WHITE[MIDDLE + 12], 4, 5, 12)]
    timed = time_presses(presses, 1)
    assert [(one.first, one.last) for one in timed] == [(1, 9), (5, 12)]


def test_all_keys_of_a_chord_make_room_for_a_leap():
    chord = [Press(WHITE[MIDDLE + 2 * i], 2 * i, 1, LONG) for i in range(3)]
    later = [Press(WHITE[MIDDLE + 14 + 2 * i], 2 * i, LONG + 1, 2 * LONG) for i in range(3)]
    timed = time_presses([*chord, *later], 1)
    end = max(one.last for one in timed[:3])
    begin = min(one.first for one in timed[3:])
    assert begin - end - 1 >= robot.LEAP_STEPS
    assert len({one.last for one in timed[:3]}) == len({one.first for one in timed[3:]}) == 1


def third(finger, later_finger, sign):
    """Return presses of two fingers on white keys a third apart, outwards."""
    return [
        Press(WHITE[MIDDLE], finger, 1, LONG),
        Press(WHITE[MIDDLE + 2 * sign], later_finger, LONG + 1, 2 * LONG),
    ]


@pytest.mark.parametrize("sign", [1, -1])
def test_fingers_that_spread_so_far_are_given_no_time_to_leap(sign):
    presses = third(0, 1, sign)
    assert gap(presses, sign) == robot.LEAP_STEPS
    free = time_presses(presses, sign, stretch=0.8)
    assert [(one.first, one.last) for one in free] == [(one.first, one.last) for one in presses]
    assert not any(one.leaps or one.leapt for one in free)
    # A third is 0.78 of what the index and the middle finger can spread.
    tight = time_presses(third(1, 2, sign), sign, stretch=0.7)
    assert tight[0].leaps


@pytest.mark.parametrize("fingers", [(0, 0), (1, 0)])
def test_neither_one_finger_nor_those_that_would_cross_spread(fingers):
    assert time_presses(third(*fingers, 1), 1, stretch=1.0)[0].leaps


def test_a_chord_of_which_one_key_is_too_far_is_leapt_to_as_a_whole():
    first, second = third(0, 1, 1)
    far = Press(WHITE[MIDDLE + 12], 4, second.first, second.last)
    alone, _ = time_presses([first, second], 1, stretch=0.8)
    with_far, near, _ = time_presses([first, second, far], 1, stretch=0.8)
    assert (alone.leaps, with_far.leaps, near.leapt) == (False, True, True)


@pytest.mark.parametrize("sign", [1, -1])
def test_whoever_hurries_loses_less_sound_but_never_gains_any(sign):
    presses = third(2, 1, sign)
    lost = presses[0].last - time_presses(presses, sign)[0].last
    assert lost >= robot.LEAP_STEPS
    for hurry, expected in ((1, lost - 1), (lost, 0), (lost + 1, 0)):
        hurried, later = time_presses(presses, sign, hurry=hurry)
        assert presses[0].last - hurried.last == expected
        assert (hurried.leaps, later.leapt) == (True, True)


def test_a_hand_leaps_from_the_last_note_before_and_from_none_earlier():
    places = ((0, 0, 1, 5), (1, 1, 6, 9), (20, 0, 10, 30))
    presses = [Press(WHITE[MIDDLE + at], finger, *states) for at, finger, *states in places]
    assert [one.leaps for one in time_presses(presses, 1)] == [False, True, False]


@pytest.mark.parametrize(
    ("leave_early", "down", "last"),
    [
        (0, (0, 40), 18),  # the leap itself takes two of the 20 states
        (3, (0, 40), 15),
        (3, (16, 40), 16),  # in step 16 the pedal goes down, and the key comes up
        (3, (17, 20), 17),  # it lifts as the note ends
        (3, (0, 19), 18),  # it lifts before
        (30, (0, 40), 1),
    ],
)
def test_a_finger_leaves_a_note_early_as_far_as_the_pedal_holds_it(leave_early, down, last):
    presses = [Press(WHITE[MIDDLE], 2, 1, 20), Press(WHITE[MIDDLE + 2], 2, 21, 40)]
    pedal = [down[0] <= step < down[1] for step in range(40)]
    first, second = time_presses(presses, 1, leave_early=leave_early, pedal=pedal)
    assert (first.first, first.last) == (1, last)
    assert (second.first, second.last) == (21, 40)


@given(hand_presses(), st.lists(st.booleans(), min_size=250, max_size=250), st.integers(1, 9))
def test_what_is_left_early_sounds_on(presses, pedal, leave_early):
    timed = time_presses(presses, 1)
    for one, left in zip(
        timed, time_presses(presses, 1, leave_early=leave_early, pedal=pedal), strict=True
    ):
        assert one.press.first <= left.first <= left.last <= one.last
        assert left.last >= one.last - leave_early
        assert all(pedal[left.last : one.last])
