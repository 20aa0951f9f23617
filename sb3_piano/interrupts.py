"""Ctrl-C and SIGTERM, answered at a moment when nothing is half done.

Python lets only the main thread handle signals; elsewhere these contexts change nothing.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

_Handler = Callable[[int, Any], Any] | int


class StopRequest:
    """Whether someone asked the work to end."""

    def __init__(self) -> None:
        self.made = False


_answering: list[StopRequest] = []
"""The request that signals make at present, if any."""


@contextlib.contextmanager
def stop_on_signal() -> Iterator[StopRequest]:
    """Turn the first Ctrl-C or SIGTERM into a request to stop; the second one raises at once.

    A block within another one has the request of that, so that none is lost when the inner one
    ends just then.

    Raises:
        KeyboardInterrupt: At the second signal.
    """
    if _answering and in_main_thread():
        yield _answering[0]
        return
    request = StopRequest()

    def handle(number: int, frame: object) -> None:
        del number, frame  # either signal means the same
        if request.made:
            raise KeyboardInterrupt
        request.made = True

    with _handlers({signal.SIGINT: handle, signal.SIGTERM: handle}) as installed:
        if not installed:
            yield request
            return
        _answering.append(request)
        try:
            yield request
        finally:
            _answering.clear()


def stop_requested() -> bool:
    """Return whether a signal asked the work of the present :func:`stop_on_signal` to end."""
    return any(request.made for request in _answering)


@contextlib.contextmanager
def ctrl_c_deferred() -> Iterator[None]:
    """Put Ctrl-C off until the end of the block."""
    came: list[int] = []
    with _handlers({signal.SIGINT: lambda number, frame: came.append(number)}):
        yield
    if came:
        signal.raise_signal(signal.SIGINT)


@contextlib.contextmanager
def ctrl_c_ignored() -> Iterator[None]:
    """Ignore Ctrl-C, also in processes that are started now, until they have their own handler."""
    with _handlers({signal.SIGINT: signal.SIG_IGN}):
        yield


def in_main_thread() -> bool:
    """Return whether this is the thread that may handle signals."""
    return threading.current_thread() is threading.main_thread()


@contextlib.contextmanager
def _handlers(wanted: Mapping[signal.Signals, _Handler]) -> Iterator[bool]:
    """Handle signals in other ways meanwhile; tell whether that is possible here."""
    if not in_main_thread():
        yield False
        return
    former = {number: signal.signal(number, handler) for number, handler in wanted.items()}
    try:
        yield True
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
