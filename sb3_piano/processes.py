"""The start of processes of environments and of studies."""

from __future__ import annotations

import multiprocessing
import multiprocessing.context
import sys
from typing import Literal

START_METHOD: Literal["forkserver", "spawn"] = (
    "forkserver" if sys.platform == "linux" else "spawn"  # macOS's libraries do not bear forks
)
_LIBRARIES = ("torch", "gymnasium", "stable_baselines3", "sb3_contrib", "scipy.optimize")


def process_context() -> (
    multiprocessing.context.ForkServerContext | multiprocessing.context.SpawnContext
):
    """Return the context in which to start processes; fork is not safe beside threads.

    On Linux they are forked from a process without threads, which has imported the libraries that
    take seconds, once for all. It is started with the first of them: later changes of environment
    variables do not reach it. Elsewhere each process is a new interpreter.
    """
    if START_METHOD == "spawn":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(_LIBRARIES))
    return context
