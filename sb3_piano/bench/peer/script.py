"""RoboPianist's side; run by the interpreter that has RoboPianist, which lacks this package.

Reads one JSON object a line and answers each with one. The first one has the environment's id and
the actions of an episode; the answer has versions. Each ``{"play": "env"}`` plays the episode and
``{"play": "physics"}`` the same controls with MuJoCo alone; the answer has steps and seconds.

The environment is built as in its authors' training script, with the flags of their run.sh.

Source: google-research/robopianist 1.0.10; kevinzakka/robopianist-rl, train.py and run.sh.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from importlib import metadata
from typing import Any


class RoboPianist:
    """Plays the same episode again and again."""

    def __init__(self, env_id: str, actions: list[list[float]]) -> None:
        import mujoco
        import numpy as np

        self._mujoco = mujoco
        self._actions = np.array(actions, dtype=np.float32)
        self._unwrapped, self._env = make_env(env_id)
        self._controls = self._record_controls()

    def play_env(self) -> tuple[int, float]:
        """Play the episode; return control steps and seconds."""
        self._env.reset()
        start = time.perf_counter()
        for action in self._actions:
            self._env.step(action)
        return len(self._actions), time.perf_counter() - start

    def play_physics(self) -> tuple[int, float]:
        """Play the episode's controls with nothing but MuJoCo; return control steps and seconds."""
        model = self._unwrapped.physics.model.ptr
        data = self._mujoco.MjData(model)
        n_substeps = round(self._unwrapped.control_timestep() / model.opt.timestep)
        start = time.perf_counter()
        for control in self._controls:
            data.ctrl[:] = control
            self._mujoco.mj_step(model, data, nstep=n_substeps)
        return len(self._controls), time.perf_counter() - start

    def _record_controls(self) -> list[Any]:
        self._env.reset()
        controls = []
        for step, action in enumerate(self._actions, start=1):
            timestep = self._env.step(action)
            if timestep.last() and step < len(self._actions):
                raise ValueError(f"the episode has {step} steps, not {len(self._actions)}")
            controls.append(self._unwrapped.physics.data.ctrl.copy())
        return controls


def make_env(env_id: str) -> tuple[Any, Any]:
    """Return the environment bare and as its authors wrap it for training."""
    wrappers = importlib.import_module("dm_env_wrappers")
    suite = importlib.import_module("robopianist.suite")

    unwrapped = suite.load(
        env_id,
        seed=0,
        task_kwargs={
            "n_steps_lookahead": 10,
            "trim_silence": True,
            "gravity_compensation": True,
            "reduced_action_space": True,
            "control_timestep": 0.05,
            "wrong_press_termination": False,
            "primitive_fingertip_collisions": True,
            "change_color_on_activation": True,
        },
    )
    env = wrappers.EpisodeStatisticsWrapper(unwrapped, deque_size=1)
    env = wrappers.ObservationActionRewardWrapper(env)
    env = wrappers.ConcatObservationWrapper(env)
    env = wrappers.CanonicalSpecWrapper(env, clip=True)
    env = wrappers.SinglePrecisionWrapper(env)
    return unwrapped, wrappers.DmControlWrapper(env)


def versions() -> dict[str, str]:
    """Return the versions that the figures depend on, by name."""
    packages = ("robopianist", "mujoco", "dm-control", "numpy")
    return {**{p: metadata.version(p) for p in packages}, "python": platform.python_version()}


def serve(lines: Iterator[str], answer: Callable[[dict[str, Any]], None]) -> None:
    """Answer every line until there is none."""
    first = json.loads(next(lines))
    try:
        found = versions()
        peer = RoboPianist(first["env_id"], first["actions"])
    except Exception as error:  # whatever it is, our side tells it to the user
        answer({"error": " ".join(f"{type(error).__name__}: {error}".split())})
        return
    answer(found)
    plays = {"env": peer.play_env, "physics": peer.play_physics}
    for line in lines:
        steps, seconds = plays[json.loads(line)["play"]]()
        answer({"steps": steps, "seconds": seconds})


def main() -> None:
    """Keep standard output for the answers: what libraries print goes to standard error."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)

    def answer(message: dict[str, Any]) -> None:
        answers.write(json.dumps(message) + "\n")

    serve(iter(sys.stdin.readline, ""), answer)


if __name__ == "__main__":
    main()
