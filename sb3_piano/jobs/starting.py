"""Start method of worker and environment processes."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.context
import multiprocessing.util
import os
import sys
from multiprocessing import forkserver
from pathlib import Path

from sb3_piano.unfinished import delete_unowned, own

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Default environment variables of new processes: one thread per library."""

_OURS = ".sb3-piano"
_LIBRARIES = ("torch", "gymnasium", "stable_baselines3", "sb3_contrib", "scipy.optimize")


def process_context() -> (
    multiprocessing.context.ForkServerContext | multiprocessing.context.SpawnContext
):
    """Return the multiprocessing context for new processes; fork is not safe with threads.

    On Linux, processes are forked from a server without threads that has imported the slow
    libraries once, if this process has. It starts with the first process and does not see later
    changes of environment variables. Elsewhere each process is a new interpreter.
    """
    _share_temporary_folder()
    if sys.platform != "linux":  # macOS's libraries are not fork-safe
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    loaded = [name for name in _LIBRARIES if name in sys.modules]
    context.set_forkserver_preload(["sb3_piano.orphans", *loaded])
    added = ONE_THREAD.keys() - os.environ.keys()
    os.environ.update({name: ONE_THREAD[name] for name in added})
    forkserver.ensure_running()
    for name in added:
        del os.environ[name]
    return context


def _share_temporary_folder() -> None:
    """Make child processes put their sockets into the temporary folder of this process.

    A killed child then leaves no folder of its own. This process marks its folder, and if it is
    killed, the next run deletes the folder by the mark. A child process shares its parent's folder
    and does not mark it, as the folder outlives the child.
    """
    if multiprocessing.parent_process() is not None:
        return
    folder = Path(multiprocessing.util.get_temp_dir())
    if (folder / _OURS).exists():
        return
    with contextlib.suppress(OSError):  # Windows cannot open folders
        own(os.open(folder, os.O_RDONLY))
        (folder / _OURS).touch()
        delete_unowned(mark.parent for mark in folder.parent.glob(f"pymp-*/{_OURS}"))
