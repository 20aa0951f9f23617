"""A study so small that its trials take a second, and wrappers that go wrong on purpose."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import gymnasium as gym
import torch

from sb3_piano.interrupts import stop_requested
from sb3_piano.tuning import Space, StudyConfig

ENV_ID = "RoboPianist-debug-CMajorChordProgressionTwoHands-v0"  # the shortest one
ENTRY = {
    "n_timesteps": 40,
    "policy": "MlpPolicy",
    "policy_kwargs": {"net_arch": [8]},
    "env_kwargs": {"n_steps_lookahead": 1, "physics": "fast"},
    "learning_starts": 20,
    "buffer_size": 100,
    "batch_size": 8,
    "gamma": 0.8,
}


def small_study(space=None, entry=None, **settings) -> StudyConfig:
    """Return a study of TD3 with 40 steps a training, two evaluations of each."""
    space = Space({"gamma": {"float": [0.7, 0.9]}} if space is None else space)
    arguments = {"env_id": ENV_ID, "n_evaluations": 2, **settings}
    return StudyConfig(algo="td3", entry={**ENTRY, **(entry or {})}, space=space, **arguments)


def wrapped(wrapper: type[gym.Wrapper], **arguments) -> dict:
    """Return what an entry says to have a wrapper of this module."""
    return {"env_wrapper": {f"{__name__}.{wrapper.__name__}": arguments}}


class Killed(gym.Wrapper):
    """Kill a process at step 10, as a system without memory does.

    It is this one, or that whose id is in the file ``other``. If there is a ``marker``, that is
    done once.
    """

    def __init__(self, env: gym.Env, marker: str | None = None, other: str | None = None):
        super().__init__(env)
        self._marker, self._other, self._left = marker and Path(marker), other, 10

    def step(self, action):
        self._left -= 1
        if self._left == 0 and not (self._marker and self._marker.exists()):
            if self._marker:
                self._marker.touch()
            other = self._other and Path(self._other).read_text()
            os.kill(int(other or os.getpid()), signal.SIGKILL)
        return self.env.step(action)


class HeldUntil(gym.Wrapper):
    """Let a step last until a file is there or someone asks for the end: time to do something."""

    def __init__(self, env: gym.Env, marker: str):
        super().__init__(env)
        self._marker = Path(marker)

    def step(self, action):
        while not self._marker.exists() and not stop_requested():
            time.sleep(0.02)
        return self.env.step(action)


class ThreadsNoted(gym.Wrapper):
    """Write into a file how many threads torch has where another process makes the environment.

    That is for a training; around an evaluation's environment no network runs yet.
    """

    def __init__(self, env: gym.Env, file: str, parent: int):
        super().__init__(env)
        if os.getpid() != parent and not Path(file).exists():
            Path(file).write_text(str(torch.get_num_threads()))


class Broken(gym.Wrapper):
    """Raise an error in the middle of an episode."""

    def __init__(self, env: gym.Env, limit: float):
        super().__init__(env)
        self._limit = limit
        self._steps = 0

    def step(self, action):
        self._steps += 1
        if self._steps > self._limit:
            raise RuntimeError("a string\nhas broken")
        return self.env.step(action)
