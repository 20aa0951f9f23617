"""What torch's own number of threads costs a training, alone and beside a job on every core.

    env -u OMP_NUM_THREADS python benchmarks/torch_threads.py

Trains SAC with its default and with its settings for the debug pieces: with the threads that torch
takes by itself and with the number that this package chooses; alone, and beside a process on every
core that only computes. All of these in turn, in one process. Prints environment steps a second,
medians over the rounds, and what our choice gains, the median of the rounds' ratios.
"""

from __future__ import annotations

import argparse
import contextlib
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import torch

from sb3_piano.bench import BenchSettings
from sb3_piano.bench.learner import training_contestant
from sb3_piano.bench.rounds import Comparison, Contestant, Lap, Race
from sb3_piano.bench.rows import speed_rows
from sb3_piano.bench.settings import ENV_ID
from sb3_piano.envs import GENERAL_ID
from sb3_piano.threads import usable_cores
from sb3_piano.torch_threads import torch_threads
from sb3_piano.training import load_config


@contextlib.contextmanager
def busy(jobs: int) -> Iterator[None]:
    """Let some processes compute meanwhile, without a pause."""
    started = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(jobs)]
    try:
        yield
    finally:
        for job in started:
            job.kill()
            job.wait()


def contestant(training: Contestant, jobs: int, threads: int | None) -> Contestant:
    """Return a training with so many threads of torch, beside so many jobs."""

    def play() -> Lap:
        with busy(jobs), torch_threads(threads):
            lap = training.play()
        return Lap(steps=lap.steps, seconds=lap.seconds)

    name = f"{training.name}, beside {jobs} jobs, threads: "
    base = f"{name}{torch.get_num_threads()}"
    if threads is not None:
        return Contestant(name=base, unit=training.unit, play=play)
    versus = Comparison(label="times as fast", base=base)
    return Contestant(name=f"{name}ours", unit=training.unit, play=play, comparisons=(versus,))


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=20, help="of training in a lap")
    arguments = parser.parse_args()
    torchs = torch.get_num_threads()
    settings = BenchSettings(transitions=300, training_steps=arguments.steps)
    small: dict[str, Any] = {
        "seed": 0,
        "monitor_kwargs": {},
        "buffer_size": 300,
        "learning_starts": 300,
    }
    score = {"score": gym.spec(ENV_ID).kwargs["score"]}
    configs = {
        "SAC, default": load_config("sac", GENERAL_ID, env_kwargs=score, **small),
        "SAC, debug pieces": load_config("sac", ENV_ID, **small),
    }
    with contextlib.ExitStack() as stack:
        trainings = [
            training_contestant(name, settings, config, stack) for name, config in configs.items()
        ]
        race = Race(
            "training",
            [
                contestant(training, jobs, threads)
                for training in trainings
                for jobs in (0, usable_cores())
                for threads in (torchs, None)
            ],
        )
        race.run(arguments.rounds)
    for row in speed_rows(race.part, race.contestants, race.rounds):
        gain = "".join(f"  {value:.2f} {label}" for label, value in row.ratios.items())
        print(f"{row.name:50s} {row.value:6.1f} {row.unit}{gain}")


if __name__ == "__main__":
    main()
