"""Fingers that suit the hand: what it can do as it is written stays, what it cannot is changed."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hand_parts import SETTINGS, hand_presses, keys_of, scene_of
from hypothesis import given, settings
from hypothesis import strategies as st
from short_pieces import both_hands, five_fingers, planned, roll_of

from sb3_piano.music import Note, Score
from sb3_piano.planning import fingers
from sb3_piano.planning.fingers import _Costs, choose, fit_fingers
from sb3_piano.planning.presses import Press
from sb3_piano.simulation import KEY_IS_BLACK

KEYS = keys_of(scene_of())
WHITE = [key for key in range(88) if not KEY_IS_BLACK[key]]
MIDDLE = 23  # of the white keys: C4
AS_WRITTEN = dataclasses.replace(SETTINGS, change_finger=1e6)


def chord(*notes, sign=1, first=1, last=20):
    """Return presses of (white keys away from the middle one, finger)."""
    return [Press(WHITE[MIDDLE + sign * away], finger, first, last) for away, finger in notes]


def sound_together(one, two):
    return one.first <= two.last and two.first <= one.last


@settings(max_examples=60, deadline=None)
@given(hand_presses(), st.sampled_from([1, -1]))
def test_no_finger_holds_two_keys_while_the_hand_has_enough_fingers(presses, sign):
    chosen = choose(presses, sign, KEYS, SETTINGS)
    assert len(chosen) == len(presses)
    assert set(chosen) <= set(range(5))
    most = max(
        sum(other.first <= press.first <= other.last for other in presses) for press in presses
    )
    for i, one in enumerate(presses):
        for j, two in enumerate(presses[:i]):
            if most <= 5 and sound_together(one, two):
                assert chosen[i] != chosen[j]


def all_ways(costs, onsets, number=0, way=()):
    """Yield the cost of every way to finger a piece."""
    if number == len(onsets):
        yield 0.0
        return
    struck = [i for i, press in enumerate(costs.presses) if press.first == onsets[number]]
    for after, cost in costs.successors(way, onsets[number], struck):
        for rest in all_ways(costs, onsets, number + 1, after):
            yield cost + rest


def cost_of(costs, onsets, given_fingers):
    """Return the cost of given fingers."""
    total, way = 0.0, ()
    for onset in onsets:
        struck = [i for i, press in enumerate(costs.presses) if press.first == onset]
        after, cost = next(
            (after, cost)
            for after, cost in costs.successors(way, onset, struck)
            if all(given_fingers[i] == finger for i, finger in after)
        )
        total, way = total + cost, after
    return total


@settings(max_examples=40, deadline=None)
@given(hand_presses(most=5), st.sampled_from([1, -1]))
def test_no_other_fingers_cost_less(presses, sign):
    costs = _Costs(presses, sign, KEYS, SETTINGS)
    onsets = sorted({press.first for press in presses})
    chosen = cost_of(costs, onsets, choose(presses, sign, KEYS, SETTINGS))
    assert chosen == pytest.approx(min(all_ways(costs, onsets)))


def steps_lost(distance):
    """Return what a leap without a rest loses, and its way."""
    more = sum(distance > more for more in SETTINGS.leap_more)
    return SETTINGS.leap_frames + more, fingers._LEAP_WEIGHT * distance


def line(*notes, rest=0):
    """Return presses of ten steps, one after the other."""
    return [
        chord(note, first=1 + i * (10 + rest), last=10 + i * (10 + rest))[0]
        for i, note in enumerate(notes)
    ]


WIDTH = KEYS.spacing
WRITTEN = {
    "as it is written": (line((0, 1)), [1], 0.0),
    "another finger": (line((0, 1)), [2], SETTINGS.change_finger),
    "the next finger on the next key": (line((0, 1), (1, 2)), [1, 2], 0.0),
    "a leap": (line((0, 1), (3, 1)), [1, 1], sum(steps_lost(3 * WIDTH))),
    "a far leap": (line((0, 1), (6, 1)), [1, 1], sum(steps_lost(6 * WIDTH))),
    "a leap in a rest": (line((0, 1), (3, 1), rest=2), [1, 1], fingers._LEAP_WEIGHT * 3 * WIDTH),
    "a leap after a long rest": (line((0, 1), (3, 1), rest=13), [1, 1], 0.0),
    "the same key again": (line((0, 1), (0, 1)), [1, 1], 0.5),
    "the same key after a rest": (line((0, 1), (0, 1), rest=1), [1, 1], 0.0),
    "a finger that passes": (line((0, 2), (1, 1)), [2, 1], 2.0 + sum(steps_lost(2 * WIDTH))),
    "a thumb that passes": (line((0, 1), (1, 0)), [1, 0], sum(steps_lost(2 * WIDTH))),
    "a chord": (chord((0, 0), (2, 1), (4, 4)), [0, 1, 4], 0.0),
    "a little too wide": (
        chord((0, 1), (3, 2), last=12),
        [1, 2],
        12 * (3 * WIDTH - 0.060) / 0.010,
    ),
    "far too wide": (chord((0, 1), (9, 2), last=12), [1, 2], 12 * 2.0),
    "a leap to a chord": (
        [*line((0, 1)), *chord((3, 1), (4, 2), first=11)],
        [1, 1, 2],
        # Both begin late, but the note before ends early but once.
        3 + 2 * steps_lost(3 * WIDTH)[1],
    ),
}


@pytest.mark.parametrize(("presses", "given_fingers", "expected"), WRITTEN.values(), ids=WRITTEN)
def test_what_fingers_cost(presses, given_fingers, expected):
    costs = _Costs(presses, 1, KEYS, SETTINGS)
    onsets = sorted({press.first for press in presses})
    assert cost_of(costs, onsets, given_fingers) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("hand", [0, 1])
def test_what_lies_under_the_hand_stays_as_it_is_written(hand):
    roll = roll_of(five_fingers(hand, order=(0, 2, 1, 4, 3, 2)))
    np.testing.assert_array_equal(fit_fingers(roll, KEYS, SETTINGS).roll.finger, roll.finger)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_grip_that_is_too_wide_for_its_fingers_gets_others(sign):
    wide = chord((0, 1), (5, 3), sign=sign)  # a sixth between index and ring finger
    assert choose(wide, sign, KEYS, SETTINGS) == [0, 3]


def test_a_grip_that_is_too_narrow_for_its_fingers_gets_others():
    assert choose(chord((0, 0), (1, 4)), 1, KEYS, SETTINGS) != [0, 4]


def test_thumbs_leave_black_keys_to_other_fingers():
    black = int(np.flatnonzero(KEY_IS_BLACK)[20])
    presses = [Press(black, 0, 1, 9)]
    assert choose(presses, 1, KEYS, SETTINGS) != [0]
    tolerant = dataclasses.replace(SETTINGS, thumb_on_black=0.0)
    assert choose(presses, 1, KEYS, tolerant) == [0]


def test_no_finger_but_the_thumb_passes_another_one():
    """Fourth finger, then the third beyond it: the hand would have to leap over its own finger."""
    passing = [*chord((0, 3), first=1, last=5), *chord((2, 2), first=6, last=10)]
    fourth, third = choose(passing, 1, KEYS, SETTINGS)
    assert fourth < third
    under = [*chord((0, 2), first=1, last=5), *chord((1, 0), first=6, last=10)]
    assert choose(under, 1, KEYS, dataclasses.replace(SETTINGS, change_finger=3.0)) == [2, 0]


def test_fewer_leaps_are_worth_a_change():
    """Six white keys upwards, thumb and index finger in turn: five leaps; other ways have one."""
    steps = [chord((i, i % 2), first=1 + 5 * i, last=5 + 5 * i)[0] for i in range(6)]
    chosen = choose(steps, 1, KEYS, SETTINGS)
    turns = sum(after <= before for before, after in pairwise(chosen))
    assert turns == 1


def test_with_dear_changes_all_stays_that_fingers_can_do():
    awkward = chord((0, 1), (5, 3))
    assert choose(awkward, 1, KEYS, AS_WRITTEN) == [1, 3]
    twice = choose(chord((0, 2), (2, 2)), 1, KEYS, AS_WRITTEN)
    assert twice[0] < twice[1], "one finger cannot hold both"


def test_each_note_stays_with_its_hand_and_only_labels_change():
    score = Score(
        notes=[
            Note(onset=0.0, offset=0.5, pitch=60, finger=1),
            Note(onset=0.0, offset=0.5, pitch=69, finger=3),
            Note(onset=0.0, offset=0.5, pitch=45, finger=8),
            Note(onset=0.0, offset=0.5, pitch=55, finger=6),
        ]
    )
    roll = roll_of(score)
    fitted = fit_fingers(roll, KEYS, SETTINGS).roll
    assert (fitted.finger != roll.finger).any()
    np.testing.assert_array_equal(fitted.finger < 0, roll.finger < 0)
    np.testing.assert_array_equal(fitted.finger // 5, roll.finger // 5)
    np.testing.assert_array_equal(fitted.active, roll.active)
    np.testing.assert_array_equal(fitted.onset_time, roll.onset_time)
    for key in np.flatnonzero(roll.active.any(axis=0)):
        assert len(set(fitted.finger[roll.active[:, key], key])) == 1, "a note has one finger"


@pytest.mark.slow
def test_the_plan_tells_with_which_fingers_it_plays():
    written = both_hands(order=(0, 1))
    doubled = Score(
        notes=[dataclasses.replace(note, finger=note.finger // 5 * 5 + 1) for note in written.notes]
    )
    made = planned(doubled, full=False)
    used = {int(finger) for finger in made.roll.finger[made.roll.active]}
    assert len(used) == 4
    assert made.problems == ()


WIDEST = [(0, 1, 3), (0, 2, 4), (0, 3, 5), (0, 4, 7), (1, 2, 2), (1, 3, 3), (1, 4, 4), (2, 4, 3)]


@pytest.mark.slow
@pytest.mark.parametrize(("one", "two", "away"), WIDEST)
def test_the_widest_grips_that_cost_nothing_are_within_reach(one, two, away):
    grip = chord((0, one), (away, two))
    assert choose(grip, 1, KEYS, AS_WRITTEN) == [one, two]
    costs = _Costs(grip, 1, KEYS, AS_WRITTEN)
    assert costs._grip(0, one, 1, two) == 0
    notes = [
        Note(onset=0.0, offset=0.5, pitch=21 + press.key, finger=press.finger) for press in grip
    ]
    assert planned(Score(notes=notes), dataclasses.replace(AS_WRITTEN, rounds=3)).problems == ()
