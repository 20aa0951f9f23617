import copy
import dataclasses
import pickle
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from short_scores import brute_force_goal, score_of
from yaml_rows import Tables

from sb3_piano import exceptions
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import MIN_PITCH, PianoRoll
from sb3_piano.music.presses import Press, finger_goals, presses_of_hand

tables = Tables(__file__)

KEY = 39  # middle C, pitch 60


def roll_of(*notes, dt=1.0, pedals=(), **options):
    """Roll of (onset, offset) or (onset, offset, finger), all on middle C, with steps of 1 s."""
    placed = [(onset, offset, 60, *finger) for onset, offset, *finger in notes]
    return PianoRoll.from_score(score_of(*placed, pedals=pedals, title="etude"), dt, **options)


def picture(roll, key=KEY):
    """One character a step: strike 'X', sounding '=', silent '.', impossible '!'."""
    return "".join(
        "!" if onset and not active else "X" if onset else "=" if active else "."
        for onset, active in zip(roll.onset[:, key], roll.active[:, key], strict=True)
    )


def labels(roll):
    return roll.finger[:, KEY].tolist()


@tables("notes, expected")
def test_notes_fill_steps_and_strikes_begin_after_silence(notes, expected):
    assert picture(roll_of(*notes)) == expected


@tables("notes, expected")
def test_labels_fill_the_notes(notes, expected):
    assert labels(roll_of(*notes)) == expected


class TestGrid:
    @pytest.mark.slow
    @pytest.mark.parametrize("dt", [0.05, 0.01, 0.025, 1 / 30])
    def test_whole_steps_stay_whole_wherever_they_lie(self, dt):
        for start in range(400):
            roll = roll_of((start * dt, (start + 2) * dt), dt=dt)
            assert picture(roll) == "." * start + "X=."

    def test_buffer_time_puts_silent_steps_in_front_of_notes_and_pedal(self):
        roll = roll_of((0, 0.1), pedals=[(0, 0.1)], dt=0.05, initial_buffer_time=0.1)
        assert picture(roll) == "..X=."
        assert roll.sustain.tolist() == [False, False, True, True, False]


class TestRestrikes:
    @pytest.mark.slow
    @settings(max_examples=200, deadline=None)
    @given(st.lists(st.tuples(st.integers(0, 15), st.integers(1, 5)), min_size=1, max_size=8))
    def test_strikes_follow_silence_and_only_gaps_before_them_are_missing(self, spans):
        roll = roll_of(*((start, start + length) for start, length in spans))
        active, onset = roll.active[:, KEY], roll.onset[:, KEY]
        before = np.concatenate([[False], active[:-1]])
        assert (onset == (active & ~before)).all()
        union = np.zeros_like(active)
        for start, length in spans:
            union[start : start + length] = True
        missing = union & ~active
        assert not (active & ~union).any()
        assert not (missing[1:] & missing[:-1]).any()
        assert missing.sum() < len(spans)


@pytest.mark.parametrize(
    ("end", "press", "down"), [(5, (1.5, 3.5), "011000"), (2, (1, 1e300), "011")]
)
def test_the_pedal_is_down_from_the_step_of_its_press_until_that_of_its_release(end, press, down):
    roll = roll_of((0, end), pedals=[press])
    assert "".join(str(int(step)) for step in roll.sustain) == down


class TestRoll:
    def test_due_lists_keys_and_labels_of_a_step(self):
        roll = PianoRoll.from_score(score_of((0, 2, 64, 2), (0, 1, 60, 0), (1, 2, 21)), 1.0)
        assert [[a.tolist() for a in roll.due(step)] for step in range(3)] == [
            [[39, 43], [0, 2]],
            [[0, 43], [-1, 2]],
            [[], []],
        ]

    @pytest.mark.parametrize("step", [-1, 3])
    def test_due_refuses_steps_outside_the_roll(self, step):
        with pytest.raises(IndexError, match=f"Step {step} is outside the roll: expected 0 to 2"):
            roll_of((0, 2)).due(step)

    @pytest.mark.parametrize("rebuild", [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy])
    def test_arrays_are_read_only_even_in_copies(self, rebuild):
        roll = roll_of((0, 2))
        for name in ("active", "finger", "onset", "sustain", "onset_time"):
            for each in (roll, rebuild(roll)):
                with pytest.raises(ValueError, match="read-only"):
                    getattr(each, name)[0] = 0
            assert np.array_equal(getattr(rebuild(roll), name), getattr(roll, name))

    def test_given_arrays_are_copied_not_locked_and_refused_if_of_unequal_length(self):
        mine = np.zeros((3, 88), dtype=bool)
        rows = {"active": mine, "finger": mine - np.int8(1), "onset": mine}
        roll = PianoRoll(control_timestep=0.05, sustain=mine[:, 0], **rows)
        mine[0, 0] = True
        assert not roll.active.any()
        with pytest.raises(ScoreError, match=r"'sustain' has shape \(2,\): expected \(3,\)"):
            PianoRoll(control_timestep=1.0, sustain=np.zeros(2), **rows)

    def test_equal_rolls_are_those_that_say_the_same(self):
        roll = roll_of((0, 2, 1), pedals=[(0, 1)])
        assert roll.equals(roll_of((0, 2, 1), pedals=[(0, 1)]))
        later = {
            name: np.roll(getattr(roll, name), 1, axis=0)
            for name in ("active", "finger", "onset", "sustain")
        }
        later["onset_time"] = roll.onset_time + 0.1
        for name, array in later.items():
            assert not roll.equals(dataclasses.replace(roll, **{name: array})), name
        assert not roll.equals(dataclasses.replace(roll, control_timestep=0.5))
        assert not roll.equals(roll_of((0, 3, 1), pedals=[(0, 1)])), "another length"

    def test_repr_tells_size_step_and_strikes(self):
        roll = roll_of((0, 2), (3, 4))
        assert (repr(roll), roll.duration) == ("PianoRoll(5 steps of 1 s, 2 strikes)", 5.0)

    @tables("end, options, error, message")
    def test_senseless_times_are_refused(self, end, options, error, message):
        with pytest.raises(getattr(exceptions, error), match=re.escape(message)):
            roll_of((0, end), **options)


class TestOnsetTime:
    @tables("notes, buffer, expected")
    def test_a_strike_is_due_at_the_onset_of_its_note(self, notes, buffer, expected):
        roll = roll_of(*notes, initial_buffer_time=buffer)
        assert roll.onset_time == pytest.approx(expected)

    def test_times_are_ordered_by_step_then_key(self):
        score = score_of((0.5, 1.5, 60), (0.75, 1.75, 50), (3, 4, 40))
        roll = PianoRoll.from_score(score, 1.0)
        assert roll.onset_time == pytest.approx([0.75, 0.5, 3])

    def test_left_out_it_is_the_beginning_of_the_step(self):
        made = roll_of((0.25, 2), (3.9, 5), dt=1.0)
        arrays = {name: getattr(made, name) for name in ("active", "finger", "onset", "sustain")}
        assert PianoRoll(control_timestep=1.0, **arrays).onset_time == pytest.approx([0, 3])
        with pytest.raises(ScoreError, match=r"'onset_time' has shape \(1,\): expected \(2,\)"):
            PianoRoll(control_timestep=1.0, **arrays, onset_time=[0.0])


def test_labelled_fingers_are_those_of_the_notes_that_are_due():
    roll = roll_of((0, 2, 3), (3, 4), (5, 6, 9))
    pressing = [np.flatnonzero(row).tolist() for row in roll.labelled_fingers()]
    assert pressing == [[3], [3], [], [], [], [9], []]


# Presses: which finger holds which key, from the first state to the last.


def fingered_roll(*notes):
    """Return the roll of (onset, offset, finger) or (onset, offset, finger, key), steps of 1 s."""
    made = ((on, off, MIN_PITCH + (key or [KEY])[0], finger) for on, off, finger, *key in notes)
    return PianoRoll.from_score(score_of(*made), 1.0)


drawn_notes = st.builds(
    lambda onset, length, finger, key: (onset, onset + length, finger, key),
    onset=st.integers(0, 12),
    length=st.integers(1, 8),
    finger=st.integers(-1, 9),
    key=st.integers(30, 33),
)


@given(st.lists(drawn_notes, min_size=1, max_size=10))
def test_every_labelled_step_of_a_note_belongs_to_one_press_of_its_finger(drawn):
    roll = fingered_roll(*drawn)
    found = np.full(roll.active.shape, -1)
    for hand in (0, 1):
        for press in presses_of_hand(roll, hand):
            # What sounds after control step t, in state t + 1, is compared with its goal.
            steps = slice(press.first - 1, press.last)
            assert press.first <= press.last
            assert (found[steps, press.key] == -1).all()
            found[steps, press.key] = 5 * hand + press.finger
    np.testing.assert_array_equal(found, np.where(roll.active, roll.finger, -1))


@given(st.lists(drawn_notes, min_size=1, max_size=10))
def test_a_press_begins_with_every_strike_and_contains_no_other(drawn):
    roll = fingered_roll(*drawn)
    presses = [press for hand in (0, 1) for press in presses_of_hand(roll, hand)]
    begun = {(press.first - 1, press.key) for press in presses}
    for step, key in np.argwhere(roll.onset & (roll.finger >= 0)).tolist():
        assert (step, key) in begun
    for press in presses:
        assert not roll.onset[press.first : press.last, press.key].any()


def test_presses_are_in_order_of_time_then_key():
    roll = fingered_roll((2, 4, 0, 20), (0, 3, 1, 45), (0, 2, 2, 44))
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
