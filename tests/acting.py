"""What the tests of training and resuming share; configs name ``ActAt`` by its import path."""

import os
import signal

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import TD3
from stable_baselines3.common.callbacks import BaseCallback
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

VEC_ENVS = ("dummy", "threads", "subproc")
STILL = np.zeros(39, dtype=np.float32)
LOUD = np.where(np.arange(39) % 2 == 0, 0.9, -0.3).astype(np.float32)
"""An action that presses both hands' fingers down."""


class ActAt(BaseCallback):
    """Do something at one step of the training; named in configs by its import path."""

    def __init__(self, step, action="signal"):
        super().__init__()
        self.step = step
        self.action = action

    def _on_step(self):
        if self.num_timesteps != self.step:
            return True
        if self.action == "stop":
            return False
        if self.action == "crash":
            raise RuntimeError("crash")
        if self.action == "keyboard":
            raise KeyboardInterrupt
        os.kill(os.getpid(), getattr(signal, self.action))
        return True


class AtStep(gym.Wrapper):
    """Send a signal or fail at one of an environment's steps; named in configs by its import path.

    Steps are counted from 1 over all episodes.
    """

    def __init__(self, env, step, action="SIGINT"):
        super().__init__(env)
        self._left, self._action = step, action

    def step(self, action):
        self._left -= 1
        if self._left == 0 and self._action == "fail":
            raise ZeroDivisionError("of a wrapper")
        if self._left == 0:
            os.kill(os.getpid(), getattr(signal, self._action))
        return self.env.step(action)


class Noted(BaseCallback):
    """Note what a function of the callback finds in each step, unless that is ``None``."""

    def __init__(self, look):
        super().__init__()
        self.look, self.seen = look, []

    def _on_step(self):
        found = self.look(self)
        self.seen += [] if found is None else [found]
        return True


def act_at(step, action):
    return {f"{__name__}.ActAt": {"step": step, "action": action}}


def parameters(folder, algorithm=TD3):
    model = algorithm.load(folder.model_file)
    return torch.cat([p.detach().flatten() for p in model.policy.parameters()])


def states_of(model):
    """Return all parameters and optimizers' states of a model by name."""
    found = {}
    for name, states in model.get_parameters().items():
        for key, value in states.items():
            if key == "state":
                value = {f"{i}.{n}": t for i, s in value.items() for n, t in s.items()}
                found |= {f"{name}.{n}": tensor.clone() for n, tensor in value.items()}
            elif isinstance(value, torch.Tensor):
                found[f"{name}.{key}"] = value.clone()
    return found


def scalars(folder, name):
    """Return the steps and values that TensorBoard's files have for a name."""
    found = {}
    for path in sorted(folder.tensorboard_dir.glob("run_*")):
        events = EventAccumulator(str(path)).Reload()
        if name in events.Tags()["scalars"]:
            found |= {event.step: event.value for event in events.Scalars(name)}
    return found
