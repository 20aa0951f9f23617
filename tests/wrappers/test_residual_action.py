"""What the agent adds to the planned pianist, what it sees of the plan, and what is refused."""

from __future__ import annotations

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from side_by_side import block

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import InvalidActionError
from sb3_piano.music import Note, Pedal, Score
from sb3_piano.planning import PlannedPianist, PlanSettings, plan
from sb3_piano.training import SavedPlayer, evaluate, play_run, train
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.wrappers import PitchShift, ResidualAction

# A second and a half with half a second to get there: the right hand steps up a third, the left
# one holds a key; the pedal is down in the middle.
PIECE = Score(
    notes=[
        Note(onset=0.0, offset=0.3, pitch=60, finger=0),
        Note(onset=0.3, offset=0.6, pitch=64, finger=2),
        Note(onset=0.2, offset=0.7, pitch=48, finger=5),
    ],
    pedals=[Pedal(onset=0.25, offset=0.5)],
    title="two hands",
)
OTHER = Score(notes=[Note(onset=0.0, offset=0.2, pitch=67, finger=1)], title="other")
OPTIONS = {"physics": "fast", "reduced_action_space": False, "initial_buffer_time": 0.5}

# What is told of the planning here is not the planner's best.
QUICK = {"rounds": 2, "iterations": 4, "dynamic_iterations": 3}
SETTINGS = PlanSettings(**QUICK)


def piano(**changes):
    return PianoEnv(PIECE, **{**OPTIONS, **changes})


@pytest.fixture(scope="module")
def planned_once():
    env = ResidualAction(piano(), 0.1, settings=QUICK)
    env.reset()  # plans
    return env


@pytest.fixture
def env(planned_once):
    """An environment that has its plan already."""
    return copy.deepcopy(planned_once)


def still(env):
    return np.zeros(env.action_space.shape, dtype=np.float32)


def commands(env):
    return env.unwrapped.data.ctrl.copy()


def play(env, policy, options=None):
    """Return the state after each control step of an episode, its metrics and its observations."""
    observation, info = env.reset(seed=0, options=options)
    states, observations, over = [], [observation], False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        states.append(env.unwrapped.data.qpos.copy())
        observations.append(observation)
        over = terminated or truncated
    return np.array(states), info, np.array(observations)


# What is played.


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [{}, {"reduced_action_space": True, "observation": "fingers"}], ids=["full", "less"]
)
def test_actions_of_zero_play_bit_by_bit_what_the_planned_pianist_plays(options):
    theirs, env = piano(**options), ResidualAction(piano(**options), settings=QUICK)
    pianist = PlannedPianist(theirs, SETTINGS)
    expected, info, _ = play(theirs, lambda seen: pianist.predict(seen)[0])
    states, own_info, _ = play(env, lambda _: still(env))
    np.testing.assert_array_equal(states, expected)
    assert own_info["f1"] == info["f1"] > 0.7
    assert env.unwrapped.performance.sustain.any()


@pytest.mark.slow
@pytest.mark.parametrize("action", [0.5, -0.25])
def test_an_action_moves_commands_by_its_share_of_the_scale(env, action):
    env.reset()
    env.step(still(env))
    twin = copy.deepcopy(env)
    env.step(still(env))
    twin.step(still(twin) + action)
    moved = commands(twin) - commands(env)
    names = [env.unwrapped.model.actuator(i).name.split("/")[1] for i in range(44)]
    per_unit = {"WRJ": 0.1 / 3, "arm": 0.1 * 0.06}
    expected = [
        next((value for part, value in per_unit.items() if part in name), 0.1) for name in names
    ]
    low, high = env.unwrapped.scene.ctrl_low, env.unwrapped.scene.ctrl_high
    inside = (commands(twin) > low + 1e-6) & (commands(twin) < high - 1e-6)
    assert inside.sum() > 30
    np.testing.assert_allclose(moved[inside], action * np.array(expected)[inside], atol=1e-6)
    assert sorted(set(expected)) == [0.1 * 0.06, 0.1 / 3, 0.1]


@pytest.mark.slow
def test_what_is_played_stays_within_the_control_ranges():
    # Only clipped actions, as wrappers inside may see them, are of the action space.
    inside = gym.wrappers.TransformAction(piano(), checked_action, None)
    env = ResidualAction(inside, 100.0, settings=QUICK)
    env.reset()
    scene = env.unwrapped.scene
    env.step(still(env) + 1)
    np.testing.assert_allclose(commands(env), scene.ctrl_high, atol=1e-6)
    env.step(still(env) - 1)
    np.testing.assert_allclose(commands(env), scene.ctrl_low, atol=1e-6)


def checked_action(action):
    assert np.abs(action).max() <= 1
    return action


# What is seen.


@pytest.mark.slow
def test_the_plan_is_shown_as_the_way_to_its_next_positions():
    env = ResidualAction(piano(), lookahead=3, settings=QUICK)
    positions = plan(env.unwrapped.roll, env.unwrapped.scene, SETTINGS).positions
    unit = 0.2 * np.tile([*[1 / 3] * 2, *[1] * 18, *[0.06] * 2], 2)
    random, step = np.random.default_rng(1), 0
    observation, _ = env.reset()
    while True:
        measured = env.unwrapped.data.actuator_length
        for row, shown in enumerate(block(env, observation, "plan")):
            planned = positions[min(step + 1 + row, len(positions) - 1)]
            expected = np.clip((planned - measured) / unit, -5, 5)
            np.testing.assert_allclose(shown, expected, atol=1e-4)
        if step == len(env.unwrapped.roll):
            break
        observation, *_ = env.step(random.uniform(-1, 1, 44).astype(np.float32))
        assert env.observation_space.contains(observation)
        step += 1


# Pieces.


@pytest.mark.slow
def test_a_wrapper_further_out_chooses_the_piece_that_is_planned():
    shifted = PitchShift(ResidualAction(piano(), settings=QUICK), 2)
    _, info, _ = play(shifted, lambda _: still(shifted))
    assert shifted.unwrapped.roll.active[:, 62 - 21].any()
    assert info["f1"] > 0.7


@pytest.mark.slow
def test_another_piece_is_planned_at_its_reset_and_the_first_one_is_not_forgotten(env):
    before, _, _ = play(env, lambda _: still(env))
    _, info, _ = play(env, lambda _: still(env), options={"score": OTHER})
    assert info["f1"] > 0.7
    again, _, _ = play(env, lambda _: still(env))
    np.testing.assert_array_equal(again, before)


@pytest.mark.parametrize(
    "clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["deep", "pickle"]
)
def test_a_copy_has_the_plan_with_it(env, clone, monkeypatch):
    env.reset()
    env.step(still(env))
    twin = clone(env)
    # Whoever plans now fails.
    monkeypatch.setattr("sb3_piano.planning.pianist.plan", None)
    for each in (env, twin):
        each.step(still(each) + 0.3)
    np.testing.assert_array_equal(twin.unwrapped.data.qpos, env.unwrapped.data.qpos)


# What is refused.


@pytest.mark.parametrize("shape", [(45,), (1, 44), ()])
def test_an_action_of_another_shape_is_refused(env, shape):
    env.reset()
    with pytest.raises(InvalidActionError, match=r"expected \(44,\), one number for each actuator"):
        env.step(np.zeros(shape, dtype=np.float32))


def test_an_action_that_is_not_finite_is_refused(env):
    env.reset()
    action = still(env)
    action[3] = np.nan
    with pytest.raises(InvalidActionError, match="Element 3 of the action is nan"):
        env.step(action)


# Runs.


@pytest.mark.slow
def test_a_run_is_trained_evaluated_and_played_with_it(tmp_path):
    config = RunConfig(
        algo="sac",
        env_id="RoboPianist-debug-CMajorChordProgressionTwoHands-v0",
        n_timesteps=120,
        seed=0,
        env_kwargs=OPTIONS,
        env_wrapper=[
            {"sb3_piano.wrappers.Excerpt": {"start": 0.0, "length": 0.5}},
            {"sb3_piano.wrappers.ResidualAction": {"scale": 1e-6, "settings": QUICK}},
        ],
        callback=[{"sb3_piano.callbacks.F1Callback": {"eval_freq": 60}}],
        algorithm_kwargs={
            "policy_kwargs": {"net_arch": [8]},
            "learning_starts": 100,
            "batch_size": 8,
            "buffer_size": 200,
        },
    )
    run = train(config, tmp_path / "run", progress_bar=False).folder
    with SavedPlayer.open(run.path, best="f1") as player:
        (recording,) = player.play()
        assert player.model.action_space.shape == (44,)
    # So small a correction changes nothing: it is the planned pianist who is heard.
    (episode,) = evaluate(run.path).episodes
    assert episode["f1"] == recording.performance.metrics()["f1"] > 0.7
    assert play_run(run.path, picture=None).wav.is_file()
