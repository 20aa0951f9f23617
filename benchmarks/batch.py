"""Control steps a second of many pianos at once, by backend and number of worlds.

    python benchmarks/batch.py
    python benchmarks/batch.py --music
    python benchmarks/batch.py --backend warp --worlds 64 512 2048 4096 8192

Each row plays the C major scale: bare physics, and the whole task (actions, observations, rewards,
metrics). Actions wander about the resting place, where hands collide; with ``--music`` they are
those of the planned pianist, with some noise. On MuJoCo's threads bare physics is ``mujoco.batch``
with the same controls, without our code. Beside it are the batch and the vector environments
``threads`` and ``processes``, all with one thread or process and by processor time, medians of
rounds in turn.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import importlib
import multiprocessing
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from sb3_piano.batch import BatchedPiano
from sb3_piano.envs import PianoEnv
from sb3_piano.players import make_player
from sb3_piano.vec_env import ProcessVecEnv, ThreadVecEnv

PIECE = "debug-CMajorScaleTwoHands"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--backend", choices=["cpu", "warp"], default="cpu")
    parser.add_argument("--physics", nargs="+", default=["fast", "faithful"])
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 8, 32, 64])
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--music", action="store_true", help="play the piece (backend cpu)")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    for physics in arguments.physics:
        for worlds in arguments.worlds:
            measured = on_cpu if arguments.backend == "cpu" else on_warp
            print(physics, f"{worlds} worlds:", measured(physics, worlds, arguments), flush=True)


def actions_of(worlds: int, steps: int, size: int) -> list[np.ndarray]:
    """Return (worlds, size) actions that wander about the resting place."""
    random, action, actions = np.random.default_rng(0), np.zeros((worlds, size)), []
    for _ in range(steps):
        action = np.clip(0.9 * action + 0.3 * random.normal(size=action.shape), -1, 1)
        actions.append(action.astype(np.float32))
    return actions


def music_of(env: PianoEnv, worlds: int, steps: int) -> list[np.ndarray]:
    """Return (worlds, size) actions of the planned pianist from the start, with noise of 0.02."""
    random, played = np.random.default_rng(0), []
    player, observation = make_player("planned", env), env.reset(seed=0)[0]
    for _ in range(steps):
        action = player.predict(observation)[0]
        noise = random.normal(0, 0.02, (worlds, len(action)))
        played.append(np.clip(action + noise, -1, 1).astype(np.float32))
        observation = env.step(action)[0]
    return played


def on_cpu(physics: str, worlds: int, arguments: argparse.Namespace) -> str:
    """Return how bare physics, the batch and vectors of single environments compare."""
    took: dict[str, list[float]] = {}
    with contextlib.ExitStack() as stack:
        runs = runs_on_cpu(physics, worlds, arguments, stack)
        for _ in range(arguments.rounds):
            for name, run in runs.items():
                took.setdefault(name, []).append(seconds(run, processor_time))
    rate = worlds * arguments.steps / np.median(took["bare"])
    ratios = {name: np.median(np.divide(times, took["bare"])) for name, times in took.items()}
    others = ", ".join(f"{name} {ratio:.3f}" for name, ratio in ratios.items() if name != "bare")
    return f"bare {rate:.0f}/s; times of bare: {others}"


def runs_on_cpu(
    physics: str, worlds: int, arguments: argparse.Namespace, stack: contextlib.ExitStack
) -> dict[str, Callable[[], None]]:
    """Return the ways to play the same actions; the stack closes their processes."""
    options = {"physics": physics, "observation": "fingers"}
    env = PianoEnv(PIECE, **options)
    made = importlib.import_module("mujoco.batch").Batch(env.model, worlds, 1, True)
    if arguments.music:
        actions = music_of(env, worlds, arguments.steps)
    else:
        actions = actions_of(worlds, arguments.steps, len(env.rest_action))
    told = env.action_map
    controls = [told.middle + told.half_range * action[:, :-1] for action in actions]
    makers = [functools.partial(PianoEnv, PIECE, **options)] * worlds
    batch = BatchedPiano(worlds, PIECE, n_threads=1, **options)
    vectors = {"threads": ThreadVecEnv(makers, 1), "processes": ProcessVecEnv(makers, 1)}

    def bare() -> None:
        made.reset()
        for control in controls:
            made.bind("ctrl")[:] = control
            made.step(nstep=env.config.n_substeps)

    def tensors() -> None:
        batch.reset()
        for action in actions:
            batch.step(torch.from_numpy(action))

    def vector(venv: Any) -> None:
        venv.reset()
        for action in actions:
            venv.step(action)

    runs = {"bare": bare, "batch": tensors}
    for name, venv in vectors.items():
        stack.callback(venv.close)
        runs[name] = functools.partial(vector, venv)
    return runs


def processor_time() -> float:
    """Return the processor time of this process and of its running children, s."""
    ticks = 0
    for child in multiprocessing.active_children():
        with open(f"/proc/{child.pid}/stat") as file:
            ticks += sum(map(int, file.read().rpartition(")")[2].split()[11:13]))
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")


def on_warp(physics: str, worlds: int, arguments: argparse.Namespace) -> str:
    """Return the rates of the whole task and of bare physics, by wall clock."""
    batch = BatchedPiano(
        worlds, PIECE, backend="warp", metrics="sums", physics=physics, observation="fingers"
    )
    size = batch.action_space.shape[0]
    actions = [torch.from_numpy(a).to(batch.device) for a in actions_of(worlds, 60, size)]
    batch.reset()
    controls = [actions[0].new_zeros(worlds, size - 1) for _ in actions]

    def whole() -> None:
        for action in actions:
            batch.step(action)
        finish(batch)

    def bare() -> None:
        for control in controls:
            batch.worlds.step(control)
        finish(batch)

    rates = []
    for run in (bare, whole):
        batch.reset()
        run()
        batch.reset()
        rates.append(worlds * len(actions) / seconds(run, time.perf_counter))
    return f"bare {rates[0]:.0f}/s, whole {rates[1]:.0f}/s"


def finish(batch: BatchedPiano) -> None:
    """Wait for the device."""
    if batch.device.type == "cuda":
        torch.cuda.synchronize()


def seconds(run: Callable[[], None], clock: Callable[[], float]) -> float:
    """Return how long something takes by a clock."""
    start = clock()
    run()
    return clock() - start


if __name__ == "__main__":
    main()
