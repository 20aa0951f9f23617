"""Playback of an episode with and without its environment, here and in RoboPianist's interpreter.

That interpreter lacks this package and runs this file: it reads one JSON object a line and answers
each with one. The first has the environment's id and an episode's actions; the answer has versions.
Each ``"env"`` or ``"physics"`` plays the episode; the answer has control steps and seconds.

Its environment is built as in its authors' training script, with the flags of their run.sh.

Source: google-research/robopianist 1.0.10; kevinzakka/robopianist-rl, train.py and run.sh.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from importlib import metadata
from typing import Any

import mujoco
import numpy as np

_TASK = {
    "n_steps_lookahead": 10,
    "trim_silence": True,
    "gravity_compensation": True,
    "reduced_action_space": True,
    "control_timestep": 0.05,
    "wrong_press_termination": False,
    "primitive_fingertip_collisions": True,
    "change_color_on_activation": True,
}


def play_env(env: Any, actions: Any) -> tuple[int, float]:
    """Play actions, (steps, [slots,] size); return control steps of all slots, and seconds."""
    env.reset()
    start = time.perf_counter()
    for action in actions:
        env.step(action)
    return actions[..., 0].size, time.perf_counter() - start


def play_physics(model: Any, n_substeps: int, controls: Any) -> tuple[int, float]:
    """Play controls, (steps, nu), with nothing but MuJoCo; return control steps and seconds."""
    data = mujoco.MjData(model)
    start = time.perf_counter()
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data, nstep=n_substeps)
    return len(controls), time.perf_counter() - start


def record_controls(env: Any, ctrl: Callable[[], Any], actions: Any) -> Any:
    """Play actions; return the actuators' targets, which ``ctrl`` returns, in each step."""
    env.reset()
    controls = []
    for action in actions:
        env.step(action)
        controls.append(ctrl().copy())
    return np.array(controls)


def _robopianist(env_id: str) -> tuple[Any, Any]:
    """RoboPianist's environment, bare and as its authors wrap it for training."""
    wrappers: Any = importlib.import_module("dm_env_wrappers")
    suite: Any = importlib.import_module("robopianist.suite")
    bare = suite.load(env_id, seed=0, task_kwargs=_TASK)
    env = wrappers.EpisodeStatisticsWrapper(bare, deque_size=1)
    env = wrappers.ObservationActionRewardWrapper(env)
    env = wrappers.ConcatObservationWrapper(env)
    env = wrappers.CanonicalSpecWrapper(env, clip=True)
    env = wrappers.SinglePrecisionWrapper(env)
    return bare, wrappers.DmControlWrapper(env)


def main() -> None:
    """Answer every line of standard input; what libraries print goes to standard error."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    env_id, actions = json.loads(sys.stdin.readline())
    packages = ("robopianist", "mujoco", "dm-control", "numpy")
    versions = {package: metadata.version(package) for package in packages}
    actions = np.array(actions, dtype=np.float32)
    bare, env = _robopianist(env_id)
    controls = record_controls(env, lambda: bare.physics.data.ctrl, actions)
    n_substeps = round(bare.control_timestep() / bare.physics.timestep())
    answers.write(json.dumps({**versions, "python": platform.python_version()}) + "\n")
    for line in sys.stdin:
        if json.loads(line) == "physics":
            played = play_physics(bare.physics.model.ptr, n_substeps, controls)
        else:
            played = play_env(env, actions)
        answers.write(json.dumps(played) + "\n")


if __name__ == "__main__":
    main()
