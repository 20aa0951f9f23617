"""Parallel computations in lock step that exchange messages."""

from __future__ import annotations

import contextlib
import multiprocessing
import sys
from collections.abc import Callable, Generator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from sb3_piano.interrupts import leave_to_parent
from sb3_piano.jobs.pool import start_process
from sb3_piano.threads import usable_cores

M = TypeVar("M")
P = TypeVar("P")
R = TypeVar("R")

Exchange = Generator[M, tuple[M, ...], R]
"""Generator that yields a message, receives the messages of all generators (its own, too) in order,
and so on; finally it returns a result. All generators yield equally often."""


def run_interleaved(start: Callable[[P], Exchange[M, R]], parts: Sequence[P]) -> list[R]:
    """Run several generators in lock step; each receives the messages of all."""
    exchanges = [start(part) for part in parts]
    received: tuple[M, ...] | None = None
    while True:
        messages, results = [], []
        for exchange in exchanges:
            try:
                messages.append(exchange.send(received) if received is not None else next(exchange))
            except StopIteration as end:
                results.append(end.value)
        if results:
            return results
        received = tuple(messages)


def in_two_processes(start: Callable[[P], Exchange[M, R]], one: P, other: P) -> list[R]:
    """Run two generators in lock step, the second one in another process.

    If that process is killed, both run in this process.
    """
    ours, theirs = multiprocessing.Pipe()
    process = start_process(_do_other, theirs, start, other, daemon=True)
    theirs.close()
    try:
        return [_exchange_with(start(one), ours, is_first=True), ours.recv()]
    except (EOFError, OSError):
        return run_interleaved(start, (one, other))
    finally:
        ours.close()
        process.terminate()
        process.join()


def may_start_processes() -> bool:
    """Check whether another process has a core and can be started without side effects.

    Each process imports the main module again. This is safe for modules that run with ``-m`` and
    for installed commands. A script may lack its guard (``if __name__ == "__main__":``), and would
    do its work twice.
    """
    main = sys.modules["__main__"]
    is_script = main.__spec__ is None and Path(getattr(main, "__file__", "")).suffix == ".py"
    is_free = not multiprocessing.current_process().daemon
    return is_free and not is_script and usable_cores() > 1


def _do_other(connection: Connection, start: Callable[[P], Exchange[Any, Any]], part: P) -> None:
    """Run the second generator in its process, until the first one's process has ended."""
    leave_to_parent()
    with contextlib.suppress(EOFError, OSError):
        connection.send(_exchange_with(start(part), connection, is_first=False))


def _exchange_with(exchange: Exchange[M, R], connection: Connection, *, is_first: bool) -> R:
    """Run a generator that exchanges messages with the other one through a connection."""
    received: tuple[M, ...] | None = None
    while True:
        try:
            message = exchange.send(received) if received is not None else next(exchange)
        except StopIteration as end:
            result: R = end.value
            return result
        if is_first:  # one sends while the other receives, so that long messages cannot block
            connection.send(message)
            received = (message, connection.recv())
        else:
            received = (connection.recv(), message)
            connection.send(message)
