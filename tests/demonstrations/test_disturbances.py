"""Noise on actions, and hands that begin out of place."""

import copy
import math

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from linear_players import pendulum

from sb3_piano.demonstrations import ActuatorNoise, NoisyActions, PerturbedStart
from sb3_piano.exceptions import ConfigError
from sb3_piano.wrappers import HandActions, KeyRange

FOREARMS = [f"{side}_shadow_hand/forearm_{axis}" for side in ("rh", "lh") for axis in ("tx", "ty")]


def moved_targets(env, offsets):
    """Return by how much offsets of the action move the actuators' targets, rad or m."""
    piano = env.unwrapped
    rest = np.zeros(env.action_space.shape)
    found = []
    for offset in offsets:
        controls = [piano.action_map.controls(action)[0] for action in (rest, rest + offset)]
        found.append(controls[1] - controls[0])
    return np.array(found)


def is_forearm(env):
    model = env.unwrapped.model
    joints = [model.joint(model.actuator_trnid[i, 0]).name for i in range(model.nu)]
    return np.array(
        [
            model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT.value and name in FOREARMS
            for i, name in enumerate(joints)
        ]
    )


@pytest.mark.slow
@pytest.mark.parametrize("reduced", [True, False])
def test_noise_has_its_deviation_in_radians_and_6_cm_for_each_in_metres(piano, reduced):
    env = piano(reduced_action_space=reduced)
    noise, random = ActuatorNoise(env, 0.05), np.random.default_rng(0)
    offsets = np.array([noise.sample(random) for _ in range(20000)])
    assert (offsets[:, -1] == 0).all()  # the pedal
    std = moved_targets(env, offsets[::4]).std(axis=0)
    forearm = is_forearm(env)
    assert forearm.sum() == 4
    np.testing.assert_allclose(std[~forearm], 0.05, rtol=0.06)
    np.testing.assert_allclose(std[forearm], 0.003, rtol=0.06)


@pytest.mark.parametrize("reach", [1.2, 0.3])
def test_noise_on_actions_of_hands_moves_targets_as_much(piano, reach):
    env = HandActions(piano(), reach)
    of_piano = ActuatorNoise(env.env, 0.05).sample(np.random.default_rng(3))
    of_hands = ActuatorNoise(env, 0.05).sample(np.random.default_rng(3))
    assert of_hands.shape == env.action_space.shape
    [moved] = moved_targets(env.env, [of_piano])
    np.testing.assert_allclose(of_hands * np.abs(env.reach), moved, rtol=1e-6)


@pytest.mark.parametrize("memory", [0.0, 0.2])
def test_noise_forgets_in_time(piano, memory):
    noise, random = ActuatorNoise(piano(), 0.05, memory), np.random.default_rng(0)
    offsets = np.array([noise.sample(random) for _ in range(20000)])[:, :-1]
    offsets /= offsets.std(axis=0)
    for lag in (1, 4):
        kept = (offsets[lag:] * offsets[:-lag]).mean()
        expected = 0.0 if memory == 0 else math.exp(-0.05 * lag / memory)
        assert kept == pytest.approx(expected, abs=0.02)


class FewerActions(gym.ActionWrapper):
    """Leaves out the pedal."""

    def __init__(self, env):
        super().__init__(env)
        self.action_space = gym.spaces.Box(-1, 1, (env.action_space.shape[0] - 1,))

    def action(self, action):
        return np.append(action, -1)


def test_noise_and_starts_that_cannot_be_are_refused(piano):
    for make, message in (
        (lambda: ActuatorNoise(piano(), -0.1), "noise is -0.1: expected a finite number"),
        (lambda: ActuatorNoise(piano(), 0.1, math.nan), "noise_memory is nan"),
        (lambda: ActuatorNoise(FewerActions(piano()), 0.1), r"shape \(38,\): expected .* \(39,\)"),
        (lambda: PerturbedStart(pendulum(), 0.1), "PendulumEnv cannot be perturbed"),
        (lambda: PerturbedStart(piano(), -1), "std is -1"),
        (
            lambda: PerturbedStart(KeyRange(piano(observation="roll"), 24), 0.1),
            "right around the environment",
        ),
    ):
        with pytest.raises(ConfigError, match=message):
            make()


def commanded(env, seed):
    """Return what the actuators are told in an episode's first step."""
    env.reset(seed=seed)
    env.step(env.unwrapped.rest_action)
    return env.unwrapped.data.ctrl.copy()


def test_noise_goes_by_the_seed_and_a_copy_to_search_in_has_none(piano):
    env, without = NoisyActions(piano(), 0.01), commanded(piano(), 1)
    np.testing.assert_array_equal(commanded(env, 1), commanded(env, 1))
    differences = np.array([commanded(env, seed) - without for seed in (1, 2)])
    assert (np.abs(differences).max(axis=1) > 0.005).all()
    assert not np.array_equal(*differences)
    np.testing.assert_array_equal(commanded(copy.deepcopy(env), 1), without)


def start(env, seed):
    observation, _ = env.reset(seed=seed)
    return observation, env.unwrapped.data.qpos.copy()


@pytest.mark.slow
def test_a_perturbed_start_moves_the_hands_by_the_deviation_and_no_key(piano):
    env = PerturbedStart(piano(), 0.02)
    scene = env.unwrapped.scene
    where = np.concatenate(scene.joint_qpos)
    moves = np.array([start(env, seed)[1][where] for seed in range(150)])
    low, high = np.concatenate(scene.joint_range).T
    free = (low < -0.1) & (high > 0.1)  # where no limit cuts off
    names = np.concatenate(scene.joint_names)
    forearm = np.isin(names, FOREARMS)
    assert free.sum() > 15
    np.testing.assert_allclose(moves[:, free & ~forearm].std(axis=0), 0.02, rtol=0.25)
    np.testing.assert_allclose(moves[:, free & forearm].std(axis=0), 0.0012, rtol=0.25)
    observation, qpos = start(env, 0)
    assert (qpos[scene.key_qpos] == 0).all()
    for side, name in enumerate(("right_joints", "left_joints")):  # what is observed first
        seen = observation[env.unwrapped.observation_layout[name].slice]
        np.testing.assert_allclose(seen, qpos[scene.joint_qpos[side]], rtol=1e-6)
    np.testing.assert_array_equal(observation, start(env, 0)[0])
