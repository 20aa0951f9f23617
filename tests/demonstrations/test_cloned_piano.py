"""A clone of a few disturbed performances plays the piece by itself."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_piano.demonstrations import clone_behaviour, record

PIECE = "CMajorScaleTwoHands"
GAIN = 0.6


class Following:
    """Plays given actions, and pulls the joints back to where these brought them undisturbed."""

    def __init__(self, env, actions):
        self._piano, self._actions = env.unwrapped, actions
        scene = self._piano.scene
        self._half_range = (scene.ctrl_high - scene.ctrl_low) / 2
        self._piano.reset()
        self._path = []
        for action in actions:
            self._path.append(self._piano.data.actuator_length.copy())
            self._piano.step(action)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        step = self._piano.steps_played
        action = self._actions[step].copy()
        behind = self._path[step] - self._piano.data.actuator_length
        action[:-1] += GAIN * behind / self._half_range
        return np.clip(action, -1, 1), state


def play(model, venv):
    venv.training = False
    observation, over = venv.reset(), [False]
    while not over[0]:
        action, _ = model.predict(observation, deterministic=True)
        observation, _, over, [info] = venv.step(action)
    return info["f1"]


@pytest.mark.slow
def test_five_performances_teach_a_scale(performances):
    [good] = [p for p in performances if p.piece == PIECE and not p.options["reduced_action_space"]]

    def make():
        return gym.make("RoboPianist-v0", score=PIECE, observation="fingers", **good.options)

    env = make()
    teacher = Following(env, good["action"])
    record(teacher, env, "test/scale-v0", episodes=5, noise=[0.03])
    venv = VecNormalize(DummyVecEnv([make]), norm_reward=False)
    network = {"net_arch": [256, 256]}
    model = TD3("MlpPolicy", venv, policy_kwargs=network, buffer_size=9, seed=0, device="cpu")
    assert play(model, venv) < 0.3
    clone_behaviour(model, "test/scale-v0", epochs=25, batch_size=32, learning_rate=2e-3)
    assert play(model, venv) > 0.8
