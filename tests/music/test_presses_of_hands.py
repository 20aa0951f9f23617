"""Presses: which finger holds which key, from the first state to the last."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from short_scores import score_of

from sb3_piano.music import MIN_PITCH, PianoRoll
from sb3_piano.music.presses import Press, finger_goals, presses_of_hand

KEY = 39


def roll_of(*notes):
    """Return the roll of (onset, offset, finger) or (onset, offset, finger, key), steps of 1 s."""
    made = ((on, off, MIN_PITCH + (key or [KEY])[0], finger) for on, off, finger, *key in notes)
    return PianoRoll.from_score(score_of(*made), 1.0)


notes = st.builds(
    lambda onset, length, finger, key: (onset, onset + length, finger, key),
    onset=st.integers(0, 12),
    length=st.integers(1, 8),
    finger=st.integers(-1, 9),
    key=st.integers(30, 33),
)


@given(st.lists(notes, min_size=1, max_size=10))
def test_every_labelled_step_of_a_note_belongs_to_one_press_of_its_finger(drawn):
    roll = roll_of(*drawn)
    found = np.full(roll.active.shape, -1)
    for hand in (0, 1):
        for press in presses_of_hand(roll, hand):
            # What sounds after control step t, in state t + 1, is compared with its goal.
            steps = slice(press.first - 1, press.last)
            assert press.first <= press.last
            assert (found[steps, press.key] == -1).all()
            found[steps, press.key] = 5 * hand + press.finger
    np.testing.assert_array_equal(found, np.where(roll.active, roll.finger, -1))


@given(st.lists(notes, min_size=1, max_size=10))
def test_a_press_begins_with_every_strike_and_contains_no_other(drawn):
    roll = roll_of(*drawn)
    presses = [press for hand in (0, 1) for press in presses_of_hand(roll, hand)]
    begun = {(press.first - 1, press.key) for press in presses}
    for step, key in np.argwhere(roll.onset & (roll.finger >= 0)).tolist():
        assert (step, key) in begun
    for press in presses:
        assert not roll.onset[press.first : press.last, press.key].any()


def test_presses_are_in_order_of_time_then_key():
    roll = roll_of((2, 4, 0, 20), (0, 3, 1, 45), (0, 2, 2, 44))
    assert presses_of_hand(roll, 0) == [
        Press(key=44, finger=2, first=1, last=2, velocity=80),
        Press(key=45, finger=1, first=1, last=3, velocity=80),
        Press(key=20, finger=0, first=3, last=4, velocity=80),
    ]


def test_strikes_without_a_silent_step_between_are_told_apart_by_their_onsets():
    active, onset = np.zeros((6, 88), dtype=bool), np.zeros((6, 88), dtype=bool)
    active[1:5, KEY] = True
    onset[[1, 3], KEY] = True
    roll = PianoRoll(
        control_timestep=1.0,
        active=active,
        finger=np.where(active, 1, -1),
        onset=onset,
        sustain=np.zeros(6, dtype=bool),
    )
    assert [(p.first, p.last) for p in presses_of_hand(roll, 0)] == [(2, 3), (4, 5)]


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


@pytest.mark.slow
@given(
    notes=st.lists(
        st.tuples(st.integers(0, 25), st.integers(1, 8), st.integers(40, 48), st.integers(0, 9)),
        min_size=1,
        max_size=12,
    ),
    horizon=st.integers(1, 15),
)
def test_finger_goals_are_what_can_be_read_off_the_roll(notes, horizon):
    score = score_of(
        *((0.05 * at, 0.05 * (at + n), pitch, finger) for at, n, pitch, finger in notes)
    )
    roll = PianoRoll.from_score(score, 0.05)
    ours = finger_goals(roll, horizon)
    for step in range(len(roll)):
        for finger in range(10):
            expected = brute_force_goal(roll, finger, step, horizon)
            assert tuple(int(array[step, finger]) for array in ours) == expected, (step, finger)
