"""The observations by name: the window says what the roll says, the fingers where to go."""

import itertools
import pickle
from pathlib import Path

import numpy as np
import pytest
from episodes import assert_checks_pass, at_random, steps_of
from gymnasium import spaces
from short_scores import brute_force_goal, score_of
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.envs import ObservationSpace, PianoEnv
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Note, PianoRoll, Score
from sb3_piano.music.constants import KEY_IS_BLACK, NUM_KEYS
from sb3_piano.music.key_window import ALL_KEYS, KeyWindow

# Steps 0-2: thumb on C4 (key 39), steps 1-1: left index finger on D#2 (key 18, black); steps 6-8:
# thumb on E4 (key 43). The pedal is down in steps 2 to 4. There are ten steps.
TINY = score_of(
    (0.0, 0.15, 60, 0), (0.05, 0.1, 39, 6), (0.3, 0.45, 64, 0), pedals=[(0.1, 0.25)], title="tiny"
)


LEAP = Path(__file__).parents[2] / "examples" / "leap_hand"
BODIES = [
    {},
    {"physics": "fast", "reduced_action_space": False},
    {"hands_in_scene": "right"},
    {"hands_in_scene": "left"},
    {"hand": LEAP, "fingering": "robot"},
]


@pytest.mark.parametrize("options", BODIES, ids=str)
@pytest.mark.parametrize(
    ("observation", "binary"),
    [
        ("roll", {"goal", "fingering"}),
        ("window", {"goal", "fingering"}),
        ("fingers", set()),
        ("hands", {"right_busy", "left_busy"}),
    ],
)
def test_every_observation_passes_both_env_checkers_and_stays_in_its_space(
    observation, binary, options
):
    env = PianoEnv("CMajorScaleTwoHands", observation=observation, **options)
    assert_checks_pass(env)
    layout = env.observation_layout.values()
    for seen, *_ in itertools.islice(steps_of(env, at_random(env)), 60):
        assert env.observation_space.contains(seen)
        for block in layout:
            assert not block.binary or np.isin(seen[block.slice], (0.0, 1.0)).all()
    found = {block.name for block in layout if block.binary}
    absent = {"right": "left", "left": "right"}.get(env.config.hands_in_scene, "none")
    assert found == {name for name in binary if not name.startswith(absent)}


# The window.


def test_a_window_ends_with_the_keyboard_and_is_all_of_it_for_silence():
    octave = PianoEnv("CMajorScaleOneHand").roll
    assert KeyWindow.of(octave, 3) == KeyWindow(48, 66)  # C5 to C6 and three on either side
    for pitch, window in ((22, KeyWindow(0, 4)), (108, KeyWindow(84, 87))):
        steps = PianoRoll.from_score(score_of((0.0, 0.1, pitch, 9)), 0.05)
        assert KeyWindow.of(steps, 3) == window
    silence = PianoRoll(
        control_timestep=0.05,
        active=np.zeros_like(steps.active),
        finger=np.full_like(steps.finger, -1),
        onset=np.zeros_like(steps.onset),
        sustain=steps.sustain,
    )
    assert KeyWindow.of(silence, 3) == ALL_KEYS
    assert len(ALL_KEYS) == NUM_KEYS


def test_a_piece_that_leaves_the_window_is_refused_and_the_former_one_stays():
    env = PianoEnv("CMajorScaleOneHand", observation="window")
    env.reset(options={"score": env.score.transpose(3)})
    shifted = env.score
    with pytest.raises(ScoreError, match=r"pitch 88.*keys of pitch 69 to 87"):
        env.reset(options={"score": env.score.transpose(1)})
    assert env.score is shifted
    with pytest.raises(ScoreError, match=r"pitch 68, but.*keys of pitch 69 to 87"):
        env.reset(options={"score": env.score.transpose(-7)})


# The fingers.


def targets(env, observation):
    return observation[env.observation_layout["targets"].slice].reshape(10, 8)


def test_each_finger_sees_where_and_when_it_must_press_next_and_the_pedal_too():
    env = PianoEnv(TINY, observation="fingers", n_steps_lookahead=4)
    observation, _ = env.reset()
    # due, and the time until that changes
    pedal = [(0, 0.1), (0, 0.05), (1, 0.15), (1, 0.1), (1, 0.05), *[(0, 0.25)] * 5]
    env.action_space.seed(0)
    for step, pedal_goal in enumerate(pedal):
        block = targets(env, observation)
        for finger in range(10):
            key, onset, release = brute_force_goal(env.roll, finger, step, horizon=5)
            if key < 0:
                np.testing.assert_allclose(block[finger], [0, 0, 0, 0, 0, 0.25, 0.25, 0])
                continue
            tip = env.scene.fingertip_position(env.data)[finger]
            point = env.scene.press_point(env.data, np.array([key]))[0]
            depth = env.scene.key_angle(env.data)[key] / env.scene.key_max_angle[key]
            times = [1, 0.05 * onset, 0.05 * release, KEY_IS_BLACK[key]]
            expected = [*10 * (point - tip), depth, *times]
            np.testing.assert_allclose(block[finger], expected, atol=1e-6)
        shown = observation[env.observation_layout["pedal_goal"].slice]
        np.testing.assert_allclose(shown, pedal_goal, atol=1e-6)
        observation, *_ = env.step(env.action_space.sample())


def test_wrong_keys_are_counted_up_to_ten():
    env = PianoEnv(TINY, observation="fingers")
    env.reset()
    state = env.get_state()
    for pressed, shown in [([], 0), ([39, 50, 51], 2), (range(20, 40), 10)]:
        env.set_state(state)
        env.data.qpos[env.scene.key_qpos[list(pressed)]] = env.scene.key_max_angle[list(pressed)]
        observation = env.set_state(env.get_state())
        assert observation[env.observation_layout["wrong_keys"].slice].tolist() == [shown]


@pytest.mark.parametrize(
    ("observation", "message"),
    [
        ("fingers", r"pitch 60 at control step 0 has no finger label.*window"),
        ("hands", "observation 'hands' expects one for every note"),
    ],
)
def test_pieces_without_fingers_are_refused_unless_fingers_are_found(observation, message):
    unlabelled = Score(notes=[Note(onset=0.0, offset=0.1, pitch=60)])
    with pytest.raises(ScoreError, match=message):
        PianoEnv(unlabelled, observation=observation)
    PianoEnv(unlabelled, observation=observation, fingering="robot").reset()


# The space that knows its layout.


def test_the_space_knows_its_layout_also_inside_sb3_and_after_pickling():
    venv = DummyVecEnv([lambda: PianoEnv(TINY)])
    space = venv.observation_space
    assert isinstance(space, ObservationSpace)
    copied = pickle.loads(pickle.dumps(space))
    assert copied == space
    assert repr(copied.layout) == repr(space.layout)
    assert space == spaces.Box(space.low, space.high, dtype=np.float32)
