"""Updates a second of small networks: stock Stable-Baselines3, ours, and SBX.

    python benchmarks/updates.py --batch-size 128 1024 --device cuda
    python benchmarks/updates.py --algo SAC TD3 TQC --sbx-python sbx/bin/python

Networks of the debug presets' size (130 observations, 39 actions, two layers of 256) learn from
random transitions, all on one core. Times are the processor's on a CPU, of rounds in turn, and the
wall's on a GPU.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from updates_peer import made, seconds

from sb3_piano.policies import fast_updates
from sb3_piano.policies.batched_critics import batched_critics

ONE_THREAD = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


@contextlib.contextmanager
def with_batched_critics(model: Any) -> Iterator[None]:
    """Context manager for our updates with all critics at once, also on a CPU."""
    with batched_critics(model.critic), batched_critics(model.critic_target), fast_updates(model):
        yield


WAYS: dict[str, Any] = {
    "stock": contextlib.nullcontext,
    "fast_updates": fast_updates,
    "and batched critics": with_batched_critics,
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--algo", nargs="+", choices=["SAC", "TD3", "TQC"], default=["SAC"])
    parser.add_argument("--batch-size", nargs="+", type=int, default=[128, 1024])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--updates", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--sbx-python", help="also measure SBX: a Python that has sbx-rl")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # and that of the other process
    with contextlib.ExitStack() as stack:
        ask = None
        if arguments.sbx_python is not None:
            ask = stack.enter_context(opened(arguments.sbx_python))
        for name in arguments.algo:
            for size in arguments.batch_size:
                print(
                    f"{name}, batches of {size}:", compare(name, size, ask, arguments), flush=True
                )


def compare(name: str, size: int, ask: Any, arguments: argparse.Namespace) -> str:
    """Return the updates a second of each way."""
    package = sb3_contrib if name == "TQC" else stable_baselines3
    model = made(getattr(package, name), size, device=arguments.device)
    ways: dict[str, Callable[[], tuple[float, float]]] = {
        way: (lambda change=change: turn(model, change, size, arguments))  # type: ignore[misc]
        for way, change in WAYS.items()
    }
    if ask is not None:
        ways["SBX"] = lambda: ask(name, size, arguments.updates)
    took: dict[str, list[float]] = {way: [] for way in ways}
    for _ in range(arguments.rounds):
        for way, measured in ways.items():
            took[way].append(measured()[arguments.device != "cpu"])
    ours = took["fast_updates"]
    return ", ".join(
        f"{way} {arguments.updates / np.median(times):.1f}/s "
        f"({np.median(np.divide(ours, times)):.2f} of ours)"
        for way, times in took.items()
    )


def turn(model: Any, change: Any, size: int, arguments: argparse.Namespace) -> tuple[float, float]:
    """Return how long updates take, after some to warm up."""
    with change(model):
        model.train(3, size)
        if arguments.device != "cpu":
            torch.cuda.synchronize()
        return seconds(model, size, arguments.updates)


@contextlib.contextmanager
def opened(python: str) -> Iterator[Callable[..., tuple[float, float]]]:
    """Context manager for SBX in a process of its own, with one thread."""
    command = [python, str(Path(__file__).with_name("updates_peer.py"))]
    env = {**os.environ, "XLA_FLAGS": ONE_THREAD, "JAX_PLATFORMS": "cpu"}
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env
    )

    def ask(*line: Any) -> tuple[float, float]:
        assert process.stdin is not None
        assert process.stdout is not None
        print(*line, file=process.stdin, flush=True)
        processor, wall = map(float, process.stdout.readline().split())
        return processor, wall

    try:
        yield ask
    finally:
        process.communicate()


if __name__ == "__main__":
    main()
