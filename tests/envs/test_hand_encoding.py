"""The observation of hands that have read the piece, both as right hands."""

import dataclasses
import warnings

import mujoco
import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.envs.hand_encoding import FRAMES_AHEAD, LINE_AHEAD, PLACES_AHEAD
from sb3_piano.exceptions import PlanWarning
from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.music import Note, Score
from sb3_piano.music.fingering import apply_fingering
from sb3_piano.planning.arm import Arm
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.reading import KeyPlaces, read_piece

# The right thumb plays C4 twice, with E4 in between by the middle finger, and goes far up; the left
# index finger holds a black key. Steps are 0.05 s, after ten of silence.
PIECE = score_of(
    (0.0, 0.2, 60, 0),
    (0.2, 0.4, 64, 2),
    (0.4, 0.6, 60, 0),
    (0.1, 0.5, 46, 6),
    (0.8, 1.0, 84, 0),
    title="hands",
)
OPTIONS = {"reduced_action_space": False, "initial_buffer_time": 0.5, "physics": "fast"}
SIDES = ("right", "left")
NAMES = (
    *("positions", "velocities", "fingertips", "frames", "presses", "keys", "places", "busy"),
    *("line", "other_arm"),
)
ONE_STEP = 0.05 * np.array([1, 1, 0, 0, 0, 0, 0, 1, 1])


def piano(**changes):
    return PianoEnv(PIECE, **{"observation": "hands", **OPTIONS, **changes})


def shown(env, observation):
    """Return the blocks by name, in their shapes."""
    layout = env.observation_layout
    return {name: observation[b.slice].reshape(b.shape) for name, b in layout.items()}


def reading_of(env):
    hands = HandKinematics(env.scene, 0), HandKinematics(env.scene, 1)
    return read_piece(env.roll, hands, KeyPlaces.of(env.scene))


def moved(env, steps=14, seed=0):
    """Return an environment some steps into the piece, and what it shows."""
    env.reset(seed=0)
    random = np.random.default_rng(seed)
    for _ in range(steps):
        env.step(random.uniform(-0.3, 0.3, env.action_space.shape))
    return env, shown(env, env.step(env.rest_action)[0]), steps + 1


def test_a_mirrored_left_hand_sees_what_the_right_hand_sees():
    env = piano()
    env.reset()
    scene, random = env.scene, np.random.default_rng(3)
    low, high = scene.joint_range[0].T
    joints = random.uniform(low, high)
    speeds = random.normal(size=len(joints))
    for side, sign in ((0, 1), (1, -1)):
        mirror = np.where(np.arange(len(joints)) == len(joints) - 2, sign, 1)
        env.data.qpos[scene.joint_qpos[side]] = joints * mirror
        env.data.qvel[env.model.jnt_dofadr[scene.joints[side]]] = speeds * mirror
    mujoco.mj_step1(env.model, env.data)
    blocks = shown(env, env.set_state(env.get_state()))
    for name in ("positions", "velocities", "fingertips", "other_arm"):
        right, left = (blocks[f"{side}_{name}"] for side in SIDES)
        np.testing.assert_allclose(right, left, atol=2e-3, err_msg=name)


def test_ways_lead_from_the_fingertips_to_what_was_read():
    env, blocks, step = moved(piano())
    for side, hand, sign in zip((0, 1), reading_of(env).hands, (1, -1), strict=True):
        name = SIDES[side]
        kinematics = HandKinematics(env.scene, side)
        actuators = env.scene.actuator_positions(env.data.qpos[env.scene.hand_qpos])
        arm = sign * Arm(env.scene, kinematics).place(actuators[None, kinematics.actuators])[0]
        tips = blocks[f"{name}_fingertips"] / 10 + [0, arm, 0]
        # The planner's fingertips, whose coupled joints bend alike, are near those of the scene.
        planned = kinematics.fingertips(actuators[None, kinematics.actuators])[0]
        np.testing.assert_allclose(tips, planned * [1, sign, 1], atol=4e-3)
        frames = blocks[f"{name}_frames"]
        for row, ahead in zip(frames, FRAMES_AHEAD, strict=True):
            state = min(step + ahead, len(env.roll))
            asked = hand.frames.weight[state, :, 1] > 0
            np.testing.assert_array_equal(row[:, 3] > 0, asked)
            target = hand.frames.target[state] * [1, sign, 1]
            np.testing.assert_allclose((tips + row[:, :3] / 10)[asked], target[asked], atol=1e-5)
        place = sign * hand.place[np.minimum(step + PLACES_AHEAD, len(env.roll))]
        np.testing.assert_allclose(blocks[f"{name}_places"] / 10 + arm, place, atol=1e-5)
        assert blocks[f"{name}_line"].shape == LINE_AHEAD.shape


def test_presses_count_down_and_the_next_one_follows():
    env = piano()
    observation, _ = env.reset()
    thumb = []
    for _ in range(len(env.roll) - 1):
        thumb.append(shown(env, observation)["right_presses"][:, 0])
        observation, *_ = env.step(env.rest_action)
    now, after = np.array(thumb).swapaxes(0, 1)
    # The first C4 is down in the states 11 to 14, or shorter around a leap; the second from 19 on.
    np.testing.assert_allclose(now[:3, 4], [0.55, 0.5, 0.45], atol=1e-6)
    assert after[0, 4] - now[0, 4] == pytest.approx(0.4, abs=0.051)
    assert now[0, 6] == after[0, 6] == 1
    second = next(step for step in range(len(now)) if now[step, 4] > now[step - 1, 4] and step)
    np.testing.assert_allclose(now[second, 4:], after[second - 1, 4:] - ONE_STEP, atol=1e-6)
    assert now[-1, 6] == 1
    assert after[-1, 6] == 0  # the last note has none after it
    assert after[second + 3, 8] == 1  # to C6 the hand leaps, and strikes later than written
    assert after[second + 3, 11] < after[second + 3, 4] - 0.05 + 1e-6
    np.testing.assert_allclose(now[0, 11:], [0.5, 0.7], atol=1e-6)


def test_version_2_also_shows_how_loud_the_coming_notes_should_be():
    loud = {60: 90, 64: 50, 46: 33, 84: 127}
    notes = [dataclasses.replace(note, velocity=loud[note.pitch]) for note in PIECE.notes]
    score = dataclasses.replace(PIECE, notes=tuple(notes))
    one, two = (
        PianoEnv(score, observation="hands", hands_version=version, **OPTIONS) for version in (1, 2)
    )
    seen = []
    for env in (one, two):
        observation, _ = env.reset(seed=0)
        seen.append([shown(env, observation)])
        for _ in range(len(env.roll) - 1):
            observation, *_ = env.step(env.rest_action)
            seen[-1].append(shown(env, observation))
    for before, after in zip(*seen, strict=True):
        assert list(after) == [f"{side}_{n}" for side in SIDES for n in (*NAMES, "loudness")]
        for name, numbers in before.items():
            np.testing.assert_array_equal(after[name], numbers)
    right, left = (np.array([s[f"{side}_loudness"] for s in seen[1]]) * 127 for side in SIDES)
    # The thumb plays C4, C4 and C6, the middle finger E4; the left index finger B flat.
    np.testing.assert_allclose(right[0], [[90, 0, 50, 0, 0], [90, 0, 0, 0, 0]], atol=1e-4)
    np.testing.assert_allclose(left[0], [[0, 33, 0, 0, 0], [0, 0, 0, 0, 0]], atol=1e-4)
    np.testing.assert_allclose(right[16], [[90, 0, 50, 0, 0], [127, 0, 0, 0, 0]], atol=1e-4)
    np.testing.assert_allclose(right[-2], [[127, 0, 0, 0, 0], [0, 0, 0, 0, 0]], atol=1e-4)


def test_keys_around_a_finger_show_depth_and_whether_they_are_due():
    env = piano(physics="reference")
    player = PlannedPianist(env)
    observation, _ = env.reset(seed=0)
    state = None
    for _ in range(13):
        action, state = player.predict(observation, state)
        observation, *_ = env.step(action)
    keys = shown(env, observation)["right_keys"]
    assert keys[0, 1] > 0.9
    assert keys[0, 4] == 1
    assert keys[0, 7] == 0  # C4, held, due, white
    assert abs(keys[0, 9]) < 1.2  # cm
    assert keys[0, 6] == 0
    assert keys[0, 8] == 1  # below it lies B3, above it C#4
    left = shown(env, observation)["left_keys"]
    assert left[1, 4] == 1
    assert left[1, 7] == 1  # B flat 2, due, black


@pytest.mark.parametrize("fingering", ["robot", "ergonomic", "keep"])
def test_of_a_chord_of_twelve_notes_two_are_left_out_and_named(fingering):
    chord = [Note(onset=0.1, offset=0.4, pitch=pitch) for pitch in range(60, 72)]
    score = Score(notes=[Note(onset=0.0, offset=0.1, pitch=72), *chord], title="cluster")
    if fingering == "keep":  # as wrappers do that choose a piece with fingers
        score = apply_fingering(score, "robot")
    with pytest.warns(
        PlanWarning,
        match=r"^2 notes .*: \w+ \(pitch 6\d\) at 0.60 s: no finger is left.*; [^;]*\.$",
    ):
        env = PianoEnv(score, observation="hands", fingering=fingering, **OPTIONS)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # they are named once
        env.reset(seed=0)
        over = False
        while not over:
            observation, _, _, over, info = env.step(env.rest_action)
            assert env.observation_space.contains(observation)
    assert 0 <= info["f1"] < 1
