"""Control steps a second of many pianos at once, by backend and number of worlds.

    python benchmarks/batch.py
    python benchmarks/batch.py --backend warp --worlds 64 512 2048 4096 8192

Each row plays smooth random actions on the C major scale: bare physics, and the whole task
(actions, observations, rewards, metrics). On MuJoCo's threads bare physics is ``mujoco.batch``,
told the same, without our code. There one thread is used, times are the processor's, medians of
rounds in turn, and the single environment is one that plays the same.
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Callable

import numpy as np
import torch

from sb3_piano.batch import BatchedPiano
from sb3_piano.envs import PianoEnv

PIECE = "debug-CMajorScaleTwoHands"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--backend", choices=["cpu", "warp"], default="cpu")
    parser.add_argument("--physics", nargs="+", default=["fast", "faithful"])
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 8, 32, 64])
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=5)
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


def on_cpu(physics: str, worlds: int, arguments: argparse.Namespace) -> str:
    """Return how bare physics, the batch and single environments compare."""
    options = {"physics": physics, "observation": "fingers"}
    batch = BatchedPiano(worlds, PIECE, n_threads=1, **options)
    env = PianoEnv(PIECE, **options)
    made = importlib.import_module("mujoco.batch").Batch(env.model, worlds, 1, True)
    actions = actions_of(worlds, arguments.steps, batch.action_space.shape[0])
    told = env.action_map
    controls = [told.middle + told.half_range * action[:, :-1] for action in actions]

    def bare() -> None:
        made.reset()
        for control in controls:
            made.bind("ctrl")[:] = control
            made.step(nstep=env.config.n_substeps)

    def whole() -> None:
        batch.reset()
        for action in actions:
            batch.step(torch.from_numpy(action))

    def singly() -> None:
        env.reset()
        for action in actions:
            env.step(action[0])

    took = {run: [] for run in (bare, whole, singly)}
    for _ in range(arguments.rounds):
        for run, times in took.items():
            times.append(seconds(run, time.process_time))
    steps = {bare: worlds, whole: worlds, singly: 1}
    rates = {run: steps[run] * len(actions) / np.median(times) for run, times in took.items()}
    ratio = np.median(np.divide(took[whole], took[bare]))
    return (
        f"bare {rates[bare]:.0f}/s, whole {rates[whole]:.0f}/s ({ratio:.3f} of bare), "
        f"single environment {rates[singly]:.0f}/s"
    )


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
