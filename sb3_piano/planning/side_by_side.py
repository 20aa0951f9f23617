"""Computations that go on side by side and tell each other something from time to time."""

from __future__ import annotations

import contextlib
import multiprocessing
import sys
from collections.abc import Callable, Generator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from sb3_piano.interrupts import leave_to_parent
from sb3_piano.jobs.starting import process_context
from sb3_piano.threads import usable_cores

M = TypeVar("M")
P = TypeVar("P")
R = TypeVar("R")

Talk = Generator[M, tuple[M, ...], R]
"""A computation that yields a message, is sent those of all that go on beside it (its own, too),
in their order, and so on; in the end it returns a result. All of them yield equally often."""


def in_turns(start: Callable[[P], Talk[M, R]], parts: Sequence[P]) -> list[R]:
    """Return the results of what starts with each of some parts."""
    talks = [start(part) for part in parts]
    told: tuple[M, ...] | None = None
    while True:
        messages, results = [], []
        for talk in talks:
            try:
                messages.append(talk.send(told) if told is not None else next(talk))
            except StopIteration as end:
                results.append(end.value)
        if results:
            return results
        told = tuple(messages)


def in_two_processes(start: Callable[[P], Talk[M, R]], one: P, other: P) -> list[R]:
    """Return the same results of two parts, the second of which is done in a process of its own.

    If that process is killed, all is done in this one.
    """
    context = process_context()
    ours, theirs = context.Pipe()
    process = context.Process(target=_do_other, args=(theirs, start, other), daemon=True)
    process.start()
    theirs.close()
    try:
        return [_beside(start(one), ours, is_first=True), ours.recv()]
    except (EOFError, OSError):
        return in_turns(start, (one, other))
    finally:
        ours.close()
        process.terminate()
        process.join()


def may_start_processes() -> bool:
    """Return whether there is a core for another process, and starting one disturbs nobody.

    Each process imports the main module again. A module that runs with ``-m`` and an installed
    command can bear that; a script may lack its guard (``if __name__ == "__main__":``), and would
    do its work twice.
    """
    main = sys.modules["__main__"]
    is_script = main.__spec__ is None and Path(getattr(main, "__file__", "")).suffix == ".py"
    is_free = not multiprocessing.current_process().daemon
    return is_free and not is_script and usable_cores() > 1


def _do_other(connection: Connection, start: Callable[[P], Talk[Any, Any]], part: P) -> None:
    """Do the second part in its process, until the first one's is gone."""
    leave_to_parent()
    with contextlib.suppress(EOFError, OSError):
        connection.send(_beside(start(part), connection, is_first=False))


def _beside(talk: Talk[M, R], connection: Connection, *, is_first: bool) -> R:
    """Return the result of a part whose messages and the other's go through a connection."""
    told: tuple[M, ...] | None = None
    while True:
        try:
            message = talk.send(told) if told is not None else next(talk)
        except StopIteration as end:
            result: R = end.value
            return result
        if is_first:  # one speaks while the other listens, however long a message is
            connection.send(message)
            told = (message, connection.recv())
        else:
            told = (connection.recv(), message)
            connection.send(message)
