"""A process of a pool: it does the jobs that its parent sends, one after the other.

The pool runs this file by itself, before the package or anything else that takes long is imported,
so it needs nothing but the standard library: from its first moments on a thread waits for the end
of the parent, also while a job's libraries are still being imported.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import queue
import signal
import sys
import threading
import time
import traceback
from multiprocessing import process, spawn
from multiprocessing.connection import Connection
from typing import Any

GRACE = 60.0  # s, that a training has to save what it has


def main(requests: int, answers: int) -> None:
    """Do what comes through one pipe, send what comes of it through another, until they end."""
    todo: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    ending = threading.Event()
    for descriptor in (requests, answers):
        os.set_inheritable(descriptor, False)  # a pipe ends with this process
    listening = (Connection(requests, writable=False), todo, ending)
    threading.Thread(target=_listen, args=listening, daemon=True).start()
    out = Connection(answers, readable=False)
    _prepare(pickle.loads(todo.get()))
    while not ending.is_set():
        answer = _answer(todo.get())
        with contextlib.suppress(OSError):  # nobody is left to read it
            out.send_bytes(answer)
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # taking torch apart takes seconds, and nobody is left to wait for it


def _listen(requests: Connection, todo: queue.SimpleQueue[bytes], ending: threading.Event) -> None:
    """Take requests; end this process when the pool ends, or its process was killed.

    What trains saves a checkpoint first, see :func:`~sb3_piano.interrupts.stop_on_signal`; all else
    ends at once.
    """
    with contextlib.suppress(EOFError, OSError):
        while True:
            todo.put(requests.recv_bytes())
    ending.set()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os._exit(1)


def _prepare(parent: dict[str, Any]) -> None:
    """Take the paths and the main module of the parent, as ``multiprocessing`` does."""
    current: Any = process.current_process()
    current._config["tempdir"] = parent.pop("temporary_folder")
    current._inheriting = True  # a script without its guard is refused, and does not start others
    try:
        spawn.prepare(parent)
    finally:
        del current._inheriting


def _answer(request: bytes) -> bytes:
    """Call a function; return whether it raised, and what it returned or raised, pickled."""
    try:
        function, arguments, options = pickle.loads(request)
        return pickle.dumps((False, function(*arguments, **options)))
    except BaseException as error:
        error.add_note(f"In a worker:\n{traceback.format_exc()}")
        try:
            answer = pickle.dumps((True, error))
            pickle.loads(answer)  # many exceptions can be pickled, and not be made again
        except Exception:
            answer = pickle.dumps((True, RuntimeError(traceback.format_exc())))
        return answer


if __name__ == "__sb3_piano_worker__":
    main(*map(int, sys.argv[1:]))
