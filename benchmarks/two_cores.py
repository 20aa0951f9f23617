"""Gain from a second core: for MuJoCo alone, environments in threads, and ones in processes.

    python benchmarks/two_cores.py

Bare ``mj_step`` in one and two processes, and in two threads, shows what the machine itself allows:
the two cores of a virtual machine may be one core's hyperthreads. Beside them our vector
environment, in threads; two processes that each have one of half as many slots; and gymnasium's,
with a process for each slot and shared memory. All play the same on the fast physics, in turn.
Prints control steps a second, medians over the rounds, and how many times the first one's they
are, medians of the rounds' ratios.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import multiprocessing
import multiprocessing.pool
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AsyncVectorEnv

import sb3_piano  # noqa: F401  # registers the environments, also in other processes
from sb3_piano.lab.bench.measurement import Measurement, Row, Sample, measure
from sb3_piano.lab.bench.playback import play_env, play_physics, record_controls
from sb3_piano.lab.bench.workloads import ENV_ID, UNIT, episode_actions

BASE = "mj_step, 1 process"
SLOTS = (1, 2, 4, 8)
RESET = b"reset"


def make_env() -> gym.Env[Any, Any]:
    """Return the environment that all play in."""
    return gym.make(ENV_ID, physics="fast")


def make_vector(slots: int, **options: Any) -> Any:
    """Return our vector environment."""
    kind = gym.VectorizeMode.VECTOR_ENTRY_POINT
    return gym.make_vec(ENV_ID, slots, kind, physics="fast", **options)


@functools.cache
def physics() -> tuple[Any, npt.NDArray[np.float64]]:
    """Return the bare environment and the actuators' targets in an episode, once a process."""
    env: Any = make_env().unwrapped
    return env, record_controls(env, lambda: env.data.ctrl, episode_actions())


def play(_: object) -> int:
    """Play an episode with nothing but MuJoCo; return its steps."""
    env, controls = physics()
    return play_physics(env.model, env.config.n_substeps, controls)[0]


def of_pool(name: str, pool: multiprocessing.pool.Pool, tasks: int) -> Measurement:
    """Return bare physics in a pool of workers."""

    def run() -> Sample:
        start = time.perf_counter()
        steps = sum(pool.map(play, range(tasks), chunksize=1))
        return Sample(steps, time.perf_counter() - start)

    return compared(name, run)


def of_slots(name: str, venv: Any) -> Measurement:
    """Return a vector of environments."""
    actions = np.repeat(episode_actions()[:, None], venv.num_envs, axis=1)
    return compared(name, lambda: Sample(*play_env(venv, actions)[:2]))


def serve(connection: Any, slots: int) -> None:
    """Step a vector of environments in a worker process: observations and rewards for actions."""
    venv = make_vector(slots, n_threads=1)
    with contextlib.suppress(EOFError):
        while message := connection.recv_bytes():
            if message == RESET:
                venv.reset(seed=0)
                connection.send_bytes(RESET)
            else:
                actions = np.frombuffer(message, np.float32).reshape(slots, -1)
                observations, rewards, *_ = venv.step(actions)
                connection.send_bytes(observations.tobytes() + rewards.tobytes())


class Workers:
    """Two processes that step half of the slots each, as far as :func:`play_env` needs it."""

    def __init__(self, slots: int):
        """Start the processes."""
        context = multiprocessing.get_context("spawn")
        self.num_envs = slots
        pairs = [context.Pipe() for _ in range(2)]
        self.connections = [ours for ours, _ in pairs]
        for _, theirs in pairs:
            context.Process(target=serve, args=(theirs, slots // 2), daemon=True).start()

    def reset(self, **_: object) -> None:
        """Begin episodes in all slots."""
        self.exchange([RESET] * 2)

    def step(self, actions: npt.NDArray[np.float32]) -> None:
        """Step all slots."""
        self.exchange([half.tobytes() for half in np.split(actions, 2)])

    def exchange(self, messages: list[bytes]) -> None:
        """Let both processes work at the same time."""
        for connection, message in zip(self.connections, messages, strict=True):
            connection.send_bytes(message)
        for connection in self.connections:
            connection.recv_bytes()


def compared(name: str, run: Callable[[], Sample]) -> Measurement:
    """Return a measurement that is reported with its ratio to the first one."""
    ratios = {} if name == BASE else {"times the first": (name, BASE)}
    return Measurement(name=name, unit=UNIT, run=run, ratios=ratios)


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=20)
    rounds = parser.parse_args().rounds
    physics()
    with contextlib.ExitStack() as stack:
        two = stack.enter_context(multiprocessing.get_context("spawn").Pool(2))
        threads = stack.enter_context(multiprocessing.pool.ThreadPool(2))
        found = [
            of_pool(BASE, two, 1),
            of_pool("mj_step, 2 processes", two, 2),
            of_pool("mj_step, 2 threads", threads, 2),
        ]
        for slots in SLOTS:
            ours = stack.enter_context(contextlib.closing(make_vector(slots)))
            found.append(of_slots(f"PianoVectorEnv, {slots} slots", ours))
            if slots > 1:
                found.append(of_slots(f"2 processes, {slots} slots", Workers(slots)))
            theirs = AsyncVectorEnv([make_env] * slots, context="spawn")
            stack.enter_context(contextlib.closing(theirs))
            found.append(of_slots(f"AsyncVectorEnv, {slots} slots", theirs))
        rows: list[Row] = []
        measure("cores", found, rounds, rows)
    for row in rows:
        ratios = "".join(f"  {value:.2f} {label}" for label, value in row.ratios.items())
        print(f"{row.name:28s} {row.value:6.0f} {row.unit}{ratios}")


if __name__ == "__main__":
    main()
