"""Play an episode with and without its environment, here and in other processes.

They run this file with RoboPianist's interpreter, which lacks this package, or, with a physics
profile as argument, with another version of this package. It reads one JSON object per line and
answers each with one. The first has the environment's id and an episode's actions; the answer has
versions. Each ``"env"`` or ``"physics"`` plays the episode; the answer has control steps, seconds
and CPU seconds.

RoboPianist's environment is built as in its authors' training script, with their run.sh's flags.

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

import mujoco  # noqa: TID251  runs without this package
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


def play_env(env: Any, actions: Any) -> tuple[int, float, float]:
    """Play actions, (steps, [slots,] size); return control steps of all slots, and both times."""
    env.reset()
    start, processor = time.perf_counter(), time.process_time()
    for action in actions:
        env.step(action)
    seconds = time.perf_counter() - start
    return actions[..., 0].size, seconds, time.process_time() - processor


def play_physics(model: Any, n_substeps: int, controls: Any) -> tuple[int, float, float]:
    """Play controls, (steps, nu), with MuJoCo alone; return control steps and both times."""
    data = mujoco.MjData(model)
    start, processor = time.perf_counter(), time.process_time()
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data, nstep=n_substeps)
    return len(controls), time.perf_counter() - start, time.process_time() - processor


def record_controls(env: Any, ctrl: Callable[[], Any], actions: Any) -> Any:
    """Play actions; return the actuators' targets (from ``ctrl``) in each step."""
    env.reset()
    controls = []
    for action in actions:
        env.step(action)
        controls.append(ctrl().copy())
    return np.array(controls)


def _sb3_piano(env_id: str, profile: str) -> tuple[Any, Callable[[], tuple[Any, Any]], int]:
    """Return the environment, a function for its model and data, and its physics substeps."""
    importlib.import_module("sb3_piano.envs")
    gym: Any = importlib.import_module("gymnasium")
    env = gym.make(env_id, physics=profile).unwrapped
    return env, lambda: (env.model, env.data), env.config.n_substeps


def _robopianist(env_id: str) -> tuple[Any, Callable[[], tuple[Any, Any]], int]:
    """Return the same for RoboPianist with its authors' wrappers; a reset makes new data."""
    wrappers: Any = importlib.import_module("dm_env_wrappers")
    suite: Any = importlib.import_module("robopianist.suite")
    bare = suite.load(env_id, seed=0, task_kwargs=_TASK)
    env = wrappers.EpisodeStatisticsWrapper(bare, deque_size=1)
    env = wrappers.ObservationActionRewardWrapper(env)
    env = wrappers.ConcatObservationWrapper(env)
    env = wrappers.CanonicalSpecWrapper(env, clip=True)
    env = wrappers.SinglePrecisionWrapper(env)
    n_substeps = round(bare.control_timestep() / bare.physics.timestep())
    inside = lambda: (bare.physics.model.ptr, bare.physics.data)  # noqa: E731
    return wrappers.DmControlWrapper(env), inside, n_substeps


def main() -> None:
    """Answer every line of standard input; output of libraries goes to standard error."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    env_id, actions = json.loads(sys.stdin.readline())
    profile = sys.argv[1:]
    packages = ("mujoco", "numpy") if profile else ("robopianist", "mujoco", "dm-control", "numpy")
    versions = {package: metadata.version(package) for package in packages}
    actions = np.array(actions, dtype=np.float32)
    make = _sb3_piano if profile else _robopianist
    env, inside, n_substeps = make(env_id, *profile)
    controls = record_controls(env, lambda: inside()[1].ctrl, actions)
    model, _ = inside()
    answers.write(json.dumps({**versions, "python": platform.python_version()}) + "\n")
    for line in sys.stdin:
        if json.loads(line) == "physics":
            played = play_physics(model, n_substeps, controls)
        else:
            played = play_env(env, actions)
        answers.write(json.dumps(played) + "\n")


if __name__ == "__main__":
    main()
