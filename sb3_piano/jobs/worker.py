"""Worker process of a pool: it runs the jobs sent by its parent, one after the other.

The pool runs this file before importing the package or any other slow library, so it needs only the
standard library. From the start a thread watches for the end of the parent, also while a job's
libraries are being imported.
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

GRACE = 60.0  # s, time for a training to save a checkpoint


def main(requests: int, answers: int) -> None:
    """Run the jobs from one pipe and send their results through another, until both close."""
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
        with contextlib.suppress(OSError):  # the parent has ended
            out.send_bytes(answer)
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # torch's teardown takes seconds


def _listen(requests: Connection, todo: queue.SimpleQueue[bytes], ending: threading.Event) -> None:
    """Receive requests; end this process when the pool ends or its process was killed.

    A training saves a checkpoint first, see :func:`~sb3_piano.interrupts.stop_on_signal`; any other
    job ends at once.
    """
    with contextlib.suppress(EOFError, OSError):
        while True:
            todo.put(requests.recv_bytes())
    ending.set()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os._exit(1)


def _prepare(parent: dict[str, Any]) -> None:
    """Adopt the import paths and main module of the parent, as ``multiprocessing`` does."""
    current: Any = process.current_process()
    current._config["tempdir"] = parent.pop("temporary_folder")
    current._inheriting = True  # a script without a main guard is refused and starts no workers
    try:
        spawn.prepare(parent)
    finally:
        del current._inheriting


def _answer(request: bytes) -> bytes:
    """Call a function; return, pickled, whether it raised, and its result or exception."""
    try:
        function, arguments, options = pickle.loads(request)
        return pickle.dumps((False, function(*arguments, **options)))
    except BaseException as error:
        error.add_note(f"In a worker:\n{traceback.format_exc()}")
        try:
            answer = pickle.dumps((True, error))
            pickle.loads(answer)  # many exceptions can be pickled but not unpickled
        except Exception:
            answer = pickle.dumps((True, RuntimeError(traceback.format_exc())))
        return answer


if __name__ == "__sb3_piano_worker__":
    main(*map(int, sys.argv[1:]))
