"""Environments of five steps whose music metrics are known, and how to train in them."""

import csv

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO, TD3
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.envs import PianoEnv
from sb3_piano.wrappers import RandomPiece

EPISODE_STEPS = 5


class ScriptedEnv(gym.Env):
    """Episodes of five steps without reward; the n-th that ends has the n-th ``info`` of a list.

    After the last one the list begins anew. ``last`` is also what any other step's info has.
    """

    observation_space = gym.spaces.Box(-1.0, 1.0, (2,), dtype=np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (1,), dtype=np.float32)

    def __init__(self, infos):
        self.infos = infos
        self.ended = 0
        self.closed = False
        self.first_draws = []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.first_draws.append(self.np_random.random())
        self.steps = 0
        return np.zeros(2, dtype=np.float32), {}

    def step(self, action):
        self.steps += 1
        over = self.steps == EPISODE_STEPS
        info = {"f1": 99.0, "onset_f1": 99.0, "return_energy": 99.0}
        if over:
            info = dict(self.infos[self.ended % len(self.infos)])
            self.ended += 1
        return np.zeros(2, dtype=np.float32), 0.0, False, over, info

    def close(self):
        self.closed = True


def with_f1(*values):
    """Return the environment whose episodes have these F1."""
    return ScriptedEnv([{"f1": value} for value in values])


class NoisyEnv(gym.Env):
    """Episodes of five steps, with random numbers of its own and of numpy's global generator."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (2,), dtype=np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (1,), dtype=np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return self._observation(), {}

    def step(self, action):
        self.steps += 1
        over = self.steps == EPISODE_STEPS
        reward = float(action[0] * self.np_random.normal())
        return self._observation(), reward, False, over, {"f1": reward, "onset_f1": reward}

    def _observation(self):
        draws = [self.np_random.normal(), np.random.normal()]  # noqa: NPY002
        return np.array(draws, dtype=np.float32)


def on_pieces(*several, vector=DummyVecEnv, **options):
    """Return a vector with a piano for each list of pieces, which chooses among them."""
    options = {"physics": "fast", "n_steps_lookahead": 0, **options}
    return vector(
        [lambda own=own: RandomPiece(PianoEnv(own[0], **options), own) for own in several]
    )


def tiny(env, algorithm=TD3, **changes):
    """Return a model that only collects, unless told to learn."""
    kwargs = {
        "policy_kwargs": {"net_arch": [4]},
        "learning_starts": 10**6,
        "buffer_size": 1000,
        "batch_size": 4,
        "device": "cpu",
        "seed": 1,
        **changes,
    }
    has_names = isinstance(getattr(env, "observation_space", None), gym.spaces.Dict)
    return algorithm("MultiInputPolicy" if has_names else "MlpPolicy", env, **kwargs)


def tiny_ppo(env, n_steps, **changes):
    """Return a PPO with roll-outs of so many steps, each of which is a batch."""
    kwargs = {"n_epochs": 1, "policy_kwargs": {"net_arch": [8]}, "device": "cpu", **changes}
    return PPO("MlpPolicy", env, n_steps=n_steps, batch_size=n_steps, **kwargs)


def weights_of(model):
    """Return all weights of a policy as one vector."""
    return torch.cat([one.detach().flatten() for one in model.policy.parameters()])


vector_of = make_vec_env
"""Return a vector with a Monitor around each environment that a function makes."""


def log_lines(folder, model, steps, callback, **kwargs):
    """Train and return the lines of the log as they were written, empty cells left out."""
    model.set_logger(configure(str(folder), ["csv"]))
    model.learn(steps, callback=callback, **kwargs)
    with (folder / "progress.csv").open() as file:
        return [{k: float(v) for k, v in line.items() if v} for line in csv.DictReader(file)]


def series(lines, name):
    """Return the values of a name by step."""
    return {int(line["time/total_timesteps"]): line[name] for line in lines if name in line}
