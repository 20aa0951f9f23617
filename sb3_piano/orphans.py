"""End processes whose parent is killed while they import or make environments.

The server that forks processes imports this module first, see
:func:`~sb3_piano.jobs.pool.start_process`. It uses a timer, since threads and forks do not go
together.
"""

from __future__ import annotations

import os
import signal
import sys

_EVERY = 0.5  # s


def end_with_parent() -> None:
    """End this process within a second of its parent, from now on."""
    parent = os.getppid()

    def look(number: int, frame: object) -> None:
        del number, frame
        if os.getppid() != parent:
            os._exit(1)

    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, _EVERY, _EVERY)


def stop_looking() -> None:
    """Stop the timer: a process that waits for its parent's messages notices its end."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0)


if any("multiprocessing.forkserver" in text for text in sys.orig_argv):
    os.setpgid(0, 0)  # signals of the parent's group are the parent's to handle
    end_with_parent()
    os.register_at_fork(after_in_child=end_with_parent)
