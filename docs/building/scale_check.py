"""Checks what docs/at_scale.md assumes: what jobs cost the driver, and what a second node brings.

    python docs/building/scale_check.py

Needs two free cores and the extra ray. What is compared runs in turns, so that other load on the
machine meets all of it.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any

from sb3_piano.jobs import map_jobs, open_executor
from sb3_piano.pipelines import CorpusConfig, SweepConfig, record_corpus, sweep

os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")  # nodes on 127.0.0.1 are a cluster

JOBS = 2000
ROUNDS = 2
CORPUS = CorpusConfig(
    pieces=("repertoire",),
    players=("sight-reader",),
    excerpts=60,
    seconds=12.0,
    episodes=1,
    shard=5,
)
RUNS = SweepConfig(
    algos=("td3",),
    envs=("RoboPianist-debug-CMajorChordProgressionTwoHands-v0",),
    settings={
        "n_timesteps": 300,
        "learning_starts": 100,
        "batch_size": 32,
        "policy_kwargs": {"net_arch": [16]},
        "env_kwargs": {"physics": "fast"},
        "callback": [],
    },
    seeds=tuple(range(12)),
)


def main() -> None:
    """Print what was measured."""
    with two_nodes() as address:
        places: dict[str, Callable[[], Any]] = {
            "one process": lambda: open_executor(1),
            "two processes": lambda: open_executor(2),
            "two nodes": lambda: open_executor(ray=address),
        }
        print("| jobs | where | s | jobs a second |\n|---|---|---:|---:|")
        for where, make in places.items():
            with make() as executor:
                warm_up(executor)
                taken = seconds(
                    lambda executor=executor: list(map_jobs(executor, abs, range(JOBS)))
                )
            print(f"| {JOBS} that do nothing | {where} | {taken:.1f} | {JOBS / taken:.0f} |")
        compare("60 excerpts of 12 s", places, record)
        compare("12 runs of 300 steps", {"this process": here, **places}, train)


def compare(name: str, places: dict[str, Callable[[], Any]], work: Callable[..., Any]) -> None:
    """Print the median times of the same work at several places, and their ratios to the first."""
    found: dict[str, list[float]] = {where: [] for where in places}
    for _ in range(ROUNDS):
        for where, make in places.items():
            with make() as executor, tempfile.TemporaryDirectory() as folder:
                warm_up(executor)
                found[where].append(seconds(lambda e=executor, f=folder: work(e, Path(f, "made"))))
    print(f"\n| {name} | s, median of {ROUNDS} | times the first |\n|---|---:|---:|")
    first = next(iter(found.values()))
    for where, taken in found.items():
        ratio = median(t / f for t, f in zip(taken, first, strict=True))
        print(f"| {where} | {median(taken):.1f} | {ratio:.2f} |", flush=True)


def record(executor: Executor, folder: Path) -> None:
    """Record a corpus."""
    record_corpus(CORPUS, folder, executor=executor)


def train(executor: Executor, folder: Path) -> None:
    """Train and evaluate the runs of a sweep."""
    assert all(run.state == "finished" for run in sweep(RUNS, folder, executor=executor))


def here() -> ThreadPoolExecutor:
    """Return an executor of this process."""
    return ThreadPoolExecutor(1)


def warm_up(executor: Executor) -> None:
    """Let processes start and import what they need."""
    list(map_jobs(executor, imported, range(4)))


def imported(number: int) -> int:
    """Import what plays and trains."""
    import sb3_piano.pipelines.corpus
    import sb3_piano.pipelines.training  # noqa: F401

    return number


def seconds(work: Callable[[], object]) -> float:
    """Return how long something takes, s."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


@contextlib.contextmanager
def two_nodes() -> Iterator[str]:
    """Give the address of a cluster of Ray with two nodes of a core each, on this machine."""
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "node_ip_address": "127.0.0.1"}
    cluster = Cluster(initialize_head=True, head_node_args=node)
    try:
        cluster.add_node(**node)
        yield cluster.address
    finally:
        cluster.shutdown()


if __name__ == "__main__":
    main()
