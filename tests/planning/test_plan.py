"""Plans: what has to be true of every one of them, in all kinds of scenes."""

import dataclasses

import numpy as np
import pytest
from hand_parts import arm_of, data_at, hand_of, keys_of, scene_of
from short_pieces import (
    BUFFER,
    QUICK,
    TIMESTEP,
    five_fingers,
    key_of,
    planned,
    pressed_tips,
    roll_of,
)
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.hands import find_hand
from sb3_piano.music import PianoRoll
from sb3_piano.music.fingering import without_fingers
from sb3_piano.planning import PlanSettings, plan

tables = Tables(__file__)

PIECE = five_fingers()
NEARLY = 0.001  # m; the travel of a key is ten times that, and keys that are held push back
SCENES = pytest.mark.parametrize(
    "options",
    [
        {},
        {"physics": "fast"},
        {"full": False, "gravity_compensation": False, "moving_keys": (key_of(70), key_of(80))},
    ],
    ids=str,
)


@pytest.mark.slow
@SCENES
def test_a_plan_has_a_row_for_each_state_and_starts_with_all_joints_at_0(options):
    made, nu = planned(PIECE, **options), scene_of(**options).model.nu
    steps = len(made.roll)
    assert len(made) == steps
    assert made.positions.shape == (steps + 1, nu)
    assert made.commands.shape == (steps, nu)
    assert [hand.gains.shape for hand in made.hands] == [(steps, nu // 2, nu // 2)] * 2
    assert made.fingertips.shape == (steps + 1, 10, 3)
    assert not made.positions[0].any()
    for array in (made.positions, made.commands, *(hand.gains for hand in made.hands)):
        assert np.isfinite(array).all()


@SCENES
def test_fingers_press_their_keys_until_they_nearly_sound(options):
    made, scene = planned(PIECE, **options), scene_of(**options)
    assert (made.commands >= scene.ctrl_low).all()
    assert (made.commands <= scene.ctrl_high).all()
    across, above = pressed_tips(made, scene).T
    assert len(across) == len(PIECE.notes)
    assert across.max() < 0.006, "half a white key and half a fingertip are more"
    assert above.max() < NEARLY
    assert made.problems == ()


@SCENES
def test_a_hand_without_notes_stays_put_above_the_keys(options):
    made = planned(PIECE, **options)
    left = made.fingertips[:, 5:]
    settled = round(BUFFER / TIMESTEP)  # but for the last mm: motions are smooth
    assert np.abs(left[settled:] - left[-1]).max() < 0.008
    assert np.abs(left[2 * settled :] - left[-1]).max() < 0.001
    scene = scene_of(**options)
    arm = arm_of(scene, 1).place(made.positions[:, scene.model.nu // 2 :])
    assert np.abs(arm - arm[0]).max() < 0.02
    assert left[..., 2].min() > keys_of(scene).top[0]


@SCENES
def test_fingers_that_do_not_play_keep_off_the_keys(options):
    made, scene = planned(PIECE, **options), scene_of(**options)
    radius = hand_of(scene, 0).radius
    for step in range(len(made.roll)):
        playing = set(made.roll.finger[max(step - 2, 0) : step + 3].max(axis=1).tolist())
        for finger in set(range(5)) - playing:
            lowest = made.fingertips[step + 1, finger, 2] - radius[finger]
            assert lowest > keys_of(scene).top[0] - 0.003, (step, finger)


@pytest.mark.slow
def test_a_score_is_planned_as_its_roll_and_gets_the_fingers_it_lacks():
    score = without_fingers(five_fingers(order=(0, 1)), keep_hands=False)
    made = plan(score, scene_of(full=False), QUICK)
    assert made.roll.control_timestep == 0.05
    np.testing.assert_array_equal(made.roll.active, PianoRoll.from_score(score, 0.05).active)
    assert (made.roll.finger[made.roll.active] >= 0).all()
    of_roll = plan(made.roll, scene_of(full=False), QUICK)
    np.testing.assert_array_equal(made.commands, of_roll.commands)


@pytest.mark.parametrize(("stretch", "leaps"), [(PlanSettings().stretch, False), (0.0, True)])
def test_what_two_fingers_span_is_held_to_its_end_unless_told_otherwise(stretch, leaps):
    third = score_of((0.0, 0.5, 60, 0), (0.5, 1.0, 64, 1))
    settings = dataclasses.replace(QUICK, stretch=stretch)
    presses = plan(roll_of(third), scene_of(full=False), settings).hands[0].task.presses
    assert [one.press.finger for one in presses] == [0, 1]
    assert [one.leaps for one in presses] == [leaps, False]


def test_a_key_is_left_early_where_the_pedal_holds_its_note():
    leap = score_of((0.0, 0.5, 60, 0), (0.5, 1.0, 72, 0), pedals=[(0.1, 0.8)])
    ends = []
    for settings in (QUICK, dataclasses.replace(QUICK, leave_early=4)):
        made = plan(roll_of(leap), scene_of(full=False), settings)
        ends.append([one.last for one in made.hands[0].task.presses])
    # The leap of an octave takes four of the states 11 to 20; the pedal is down from step 12 on.
    assert ends == [[16, 30], [12, 30]]


def test_another_control_step_may_be_chosen():
    score = five_fingers(order=(0, 2), length=0.4)
    made = plan(score, scene_of(full=False), QUICK, control_timestep=0.1)
    assert made.roll.control_timestep == 0.1
    assert len(made) == 9
    assert len(made.positions) == 10


def test_in_a_scene_with_one_hand_the_others_notes_are_left_to_nobody():
    crossing = {48: 0, 52: 2, 84: 5, 80: 7}  # the left hand's are the higher ones
    notes = [(0.5, 1.0, pitch, finger) for pitch, finger in crossing.items()]
    scene = scene_of(sides=("right",), physics="fast")
    both, alone = (
        plan(PianoRoll.from_score(score_of(*of), TIMESTEP), scene, QUICK)
        for of in (notes, notes[:2])
    )
    np.testing.assert_array_equal(both.hands[0].positions, alone.hands[0].positions)
    assert not alone.problems
    assert sorted(problem.pitch for problem in both.problems) == [80, 84]


def test_a_roll_with_notes_without_fingers_is_refused_by_name():
    score = without_fingers(five_fingers(order=(0, 1)), keep_hands=False)
    with pytest.raises(ScoreError, match=r"No note of the roll has a finger.*apply_fingering"):
        plan(roll_of(score), scene_of(full=False))


LONG = five_fingers(order=(0, 1, 2, 3, 4, 2, 0, 3), length=0.2)
STRETCHES = dataclasses.replace(QUICK, window=0.8, overlap=0.4)  # 16 control steps each


@pytest.mark.slow
def test_stretches_join_into_the_motion_of_the_whole():
    """Each goes on from where the one before ended, and pushes its keys as hard."""
    parts, whole = planned(LONG, STRETCHES, full=False), planned(LONG, full=False)
    assert len(whole) > 2.5 * STRETCHES.window / TIMESTEP
    assert np.abs(parts.fingertips - whole.fingertips).max() < 0.006
    told_otherwise = np.abs(parts.commands - whole.commands).max(axis=1)
    assert np.median(told_otherwise[round(STRETCHES.window / TIMESTEP) :]) < 0.05


def test_an_arm_without_notes_makes_room_for_one_that_plays_on_its_side():
    score = five_fingers(shift=-24)
    made, scene = planned(score, full=False), scene_of(full=False)
    half = scene.model.nu // 2
    for positions in made.positions:
        data = data_at(scene, positions[:half], positions[half:])
        assert not scene.forearms_touch(data)
    right, left = (
        arm_of(scene, hand).place(made.positions[:, hand * half :][:, :half]) for hand in (0, 1)
    )
    assert left[-1] < left[0] - 0.05
    assert (right - left).min() > 0.9 * find_hand().forearm.apart
    assert pressed_tips(made, scene)[:, 1].max() < NEARLY


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 2, 5])
def test_a_piece_may_be_as_short_as_a_control_step(steps):
    active = np.zeros((steps, 88), dtype=bool)
    active[-1, 51] = True
    roll = PianoRoll(
        control_timestep=0.05,
        active=active,
        finger=np.where(active, 0, -1),
        onset=active,
        sustain=np.zeros(steps, dtype=bool),
    )
    made = plan(roll, scene_of(full=False), QUICK)
    assert made.positions.shape == (steps + 1, 38)
    assert np.isfinite(made.commands).all()


@tables("options, told")
def test_impossible_settings_are_refused_by_name(options, told):
    with pytest.raises(ConfigError, match=told):
        PlanSettings(**options)


def test_an_arm_is_not_planned_beyond_the_end_of_its_rail():
    """Black keys lie far in: an octave of them wants more of the slider than there is."""
    octaves = ((0.4 * i, p, f) for i in range(4) for p, f in ((68, 0), (80, 4)))
    octave = score_of(*((onset, onset + 0.3, pitch, finger) for onset, pitch, finger in octaves))
    scene = scene_of()
    made = planned(octave)
    inwards = hand_of(scene, 0).names.index("forearm_ty")
    low, high = scene.ctrl_low[inwards], scene.ctrl_high[inwards]
    assert made.positions[:, inwards].max() > high - 0.02, "it is needed"
    assert made.positions[:, inwards].max() < high + 0.001
    assert made.positions[:, inwards].min() > low - 0.001
