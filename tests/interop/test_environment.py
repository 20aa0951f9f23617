"""The piano as a ``dm_env`` environment."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("dm_env")
from absl.testing import absltest
from dm_env import StepType, test_utils

from sb3_piano.exceptions import ConfigError, EnvStateError
from sb3_piano.interop import DmEnvironment
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import PreviousActionReward

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
SCORE = Score(notes=[Note(onset=0.0, offset=0.4, pitch=60, finger=1)])  # nine control steps


def make_env(**options):
    return DmEnvironment("RoboPianist-v0", score=SCORE, seed=0, **options)


class TestConformance(test_utils.EnvironmentTestMixin, absltest.TestCase):
    """What dm_env itself asks of every environment."""

    def make_object_under_test(self):
        return make_env()

    def make_action_sequence(self):
        spec = self.environment.action_spec()
        for _ in range(30):
            yield np.random.default_rng(0).uniform(spec.minimum, spec.maximum).astype(spec.dtype)


def play(env, actions):
    timesteps = [env.reset()]
    timesteps += [env.step(action) for action in actions]
    return timesteps


def random_actions(count, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (count, 39)).astype(np.float32)


def test_the_steps_are_those_of_the_gymnasium_environment():
    actions = random_actions(9)
    env, reference = make_env(), gym.make("RoboPianist-v0", score=SCORE)
    timesteps = play(env, actions)
    observation, _ = reference.reset(seed=0)
    for timestep, action in zip(timesteps, [*actions, None], strict=True):
        np.testing.assert_array_equal(np.concatenate([*timestep.observation.values()]), observation)
        if action is not None:
            observation, reward, _, truncated, info = reference.step(action)
    assert truncated
    assert timesteps[-1].reward == reward
    assert env.get_musical_metrics() == {name: info[name] for name in EPISODE_METRICS}


def test_the_end_of_a_piece_keeps_the_discount_and_a_step_after_it_begins_anew():
    env = make_env()
    *_, before, last = play(env, random_actions(9))
    assert (before.step_type, before.discount) == (StepType.MID, 1.0)
    assert (last.step_type, last.discount) == (StepType.LAST, 1.0)
    assert env.step(random_actions(1)[0]).first()


def test_an_early_end_has_no_discount():
    env = make_env(wrong_press_termination=True)
    env.reset()
    piano = env.env.unwrapped
    piano.data.qfrc_applied[piano.model.joint("piano/white_joint_80").dofadr] = 5.0  # N m
    last = env.step(piano.rest_action)
    assert (last.step_type, last.discount) == (StepType.LAST, 0.0)


def test_equal_seeds_give_equal_episodes_and_only_the_first_is_seeded():
    first, second = (make_env(randomize_hand_positions=True) for _ in range(2))
    joints = "rh_shadow_hand/joints_pos"
    starts = [[env.reset().observation[joints] for _ in range(2)] for env in (first, second)]
    np.testing.assert_array_equal(starts[0], starts[1])
    assert (starts[0][0] != starts[0][1]).any()
    assert first.random_state.uniform() == second.random_state.uniform()


def test_sorted_by_name_the_blocks_stand_in_robopianists_order():
    """Its agents concatenate a dictionary of these names in the order of ``tree.flatten``."""
    assert sorted(make_env().observation_spec()) == [
        "fingering",
        "goal",
        "lh_shadow_hand/joints_pos",
        "piano/state",
        "piano/sustain_state",
        "rh_shadow_hand/joints_pos",
    ]


def test_blocks_that_a_wrapper_adds_are_there():
    env = DmEnvironment(PreviousActionReward(gym.make(ENV_ID)))
    spec, timestep = env.observation_spec(), env.reset()
    assert list(spec) == list(timestep.observation)
    assert sum(block.shape[0] for block in spec.values()) == env.env.observation_space.shape[0]
    assert len(spec) > 6


def test_other_environments_and_metrics_before_the_end_are_refused():
    env = make_env()
    env.reset()
    with pytest.raises(EnvStateError, match="No episode is over yet"):
        env.get_musical_metrics()
    with pytest.raises(ConfigError, match="cannot wrap a CartPoleEnv: expected a piano"):
        DmEnvironment("CartPole-v1")
    with pytest.raises(ConfigError, match=r"\['physics'\].*made already"):
        DmEnvironment(gym.make(ENV_ID), physics="fast")
