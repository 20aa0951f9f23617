"""Cost to a training of torch's own number of threads, alone and beside a job on every core.

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

from sb3_piano.envs import GENERAL_ID
from sb3_piano.lab.bench.measurement import Measurement, Row, Sample, measure
from sb3_piano.lab.bench.workloads import ENV_ID, training_measurement
from sb3_piano.threads import torch_computing, usable_cores
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


def beside(training: Measurement, jobs: int, threads: int | None) -> Measurement:
    """Return a training with so many threads of torch, beside so many jobs."""

    def run() -> Sample:
        with busy(jobs), torch_computing(threads):
            sample = training.run()
        return Sample(sample.count, sample.seconds)

    prefix = f"{training.name}, beside {jobs} jobs, threads: "
    base = f"{prefix}{torch.get_num_threads()}"
    if threads is not None:
        return Measurement(name=base, unit=training.unit, run=run)
    name = f"{prefix}ours"
    ratios = {"times as fast": (name, base)}
    return Measurement(name=name, unit=training.unit, run=run, ratios=ratios)


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=20, help="of training in a sample")
    arguments = parser.parse_args()
    torchs = torch.get_num_threads()
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
            training_measurement(name, config, stack, steps=arguments.steps)
            for name, config in configs.items()
        ]
        measurements = [
            beside(training, jobs, threads)
            for training in trainings
            for jobs in (0, usable_cores())
            for threads in (torchs, None)
        ]
        rows: list[Row] = []
        measure("training", measurements, arguments.rounds, rows)
    for row in rows:
        gain = "".join(f"  {value:.2f} {label}" for label, value in row.ratios.items())
        print(f"{row.name:50s} {row.value:6.1f} {row.unit}{gain}")


if __name__ == "__main__":
    main()
