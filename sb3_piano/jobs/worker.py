"""Worker process of a pool: it runs the jobs sent by its parent, one after the other."""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import threading
import time
import traceback
from collections.abc import Mapping
from multiprocessing.connection import Connection

from sb3_piano.orphans import stop_looking

GRACE = 60.0  # s, time for a training to save a checkpoint


def serve(requests: Connection, answers: Connection, environment: Mapping[str, str]) -> None:
    """Run the jobs from one pipe and send their results through another, until both close."""
    if hasattr(os, "setpgid"):  # signals of the parent's group are the parent's to handle
        os.setpgid(0, 0)
    os.environ.clear()
    os.environ.update(environment)
    todo: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    ending = threading.Event()
    threading.Thread(target=_listen, args=(requests, todo, ending), daemon=True).start()
    stop_looking()
    while not ending.is_set():
        answer = _answer(todo.get())
        with contextlib.suppress(OSError):  # the parent has ended
            answers.send_bytes(answer)


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
