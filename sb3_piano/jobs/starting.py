"""The start of processes of environments."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.context
import multiprocessing.util
import os
import sys
from pathlib import Path
from typing import Literal

from sb3_piano.unfinished import delete_unowned, own

START_METHOD: Literal["forkserver", "spawn"] = (
    "forkserver" if sys.platform == "linux" else "spawn"  # macOS's libraries do not bear forks
)
_OURS = ".sb3-piano"
_LIBRARIES = ("torch", "gymnasium", "stable_baselines3", "sb3_contrib", "scipy.optimize")


def process_context() -> (
    multiprocessing.context.ForkServerContext | multiprocessing.context.SpawnContext
):
    """Return the context in which to start processes; fork is not safe beside threads.

    On Linux they are forked from a process without threads, which has imported the libraries that
    take seconds, once for all. It is started with the first of them: later changes of environment
    variables do not reach it. Elsewhere each process is a new interpreter.
    """
    share_temporary_folder()
    if START_METHOD == "spawn":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["sb3_piano.orphans", *_LIBRARIES])
    return context


def share_temporary_folder() -> None:
    """Let processes that are started now put their sockets into this one's folder.

    One that is killed then leaves none of its own. What this one leaves if it is killed the next
    deletes, by a mark in it. A process that a program started shares that program's folder: it is
    not marked, as it outlives the process.
    """
    if multiprocessing.parent_process() is not None:
        return
    folder = Path(multiprocessing.util.get_temp_dir())
    if (folder / _OURS).exists():
        return
    with contextlib.suppress(OSError):  # Windows opens no folders
        own(os.open(folder, os.O_RDONLY))
        (folder / _OURS).touch()
        delete_unowned(mark.parent for mark in folder.parent.glob(f"pymp-*/{_OURS}"))
