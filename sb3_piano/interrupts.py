"""Ctrl-C, SIGTERM and a closed terminal, answered at a moment when nothing is half done.

Python lets only the main thread handle signals; elsewhere these contexts change nothing. Who has
SIGHUP ignored, as ``nohup`` does, goes on without a terminal.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

_Handler = Callable[[int, Any], Any] | int

_HANGUP = getattr(signal, "SIGHUP", None)  # Windows has none
OF_TERMINAL = tuple(s for s in (signal.SIGINT, _HANGUP) if s is not None)
"""Signals that reach all processes of a terminal."""

_ENDING = (*OF_TERMINAL, signal.SIGTERM)


class StopRequest:
    """Whether someone asked the work to end."""

    def __init__(self) -> None:
        self.made = False


_answering: list[StopRequest] = []
"""The request that signals make at present, if any."""


@contextlib.contextmanager
def stop_on_signal() -> Iterator[StopRequest]:
    """Turn the first Ctrl-C, SIGTERM or SIGHUP into a request to stop; the second raises at once.

    Not the second SIGHUP: a terminal that is closed and its shell both send one.

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
        del frame
        if number == _HANGUP:
            _leave_terminal()
        elif request.made:
            raise KeyboardInterrupt
        request.made = True

    with _handlers(dict.fromkeys(_ENDING, handle)) as installed:
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
def ended_as_by_ctrl_c() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise ``KeyboardInterrupt``, too, where nothing else answers them."""

    def handle(number: int, frame: object) -> None:
        del frame
        if number == _HANGUP:
            _leave_terminal()
            signal.signal(number, signal.SIG_IGN)  # the shell's own may follow
        raise KeyboardInterrupt

    with _handlers({number: handle for number in _ENDING if number != signal.SIGINT}):
        yield


@contextlib.contextmanager
def ctrl_c_deferred() -> Iterator[None]:
    """Put Ctrl-C, SIGTERM and SIGHUP off until the end of the block."""
    came: list[int] = []
    with _handlers(dict.fromkeys(_ENDING, lambda number, frame: came.append(number))):
        yield
    if came:
        signal.raise_signal(came[0])


def leave_to_parent() -> None:
    """Ignore Ctrl-C and a closed terminal in this process: the one that started it answers them.

    They reach all processes of a terminal.
    """
    for number in OF_TERMINAL:
        signal.signal(number, signal.SIG_IGN)


def _leave_terminal() -> None:
    """Print to nowhere if the terminal is gone, as every print would then be an error."""
    for stream in (1, 2):
        try:
            os.write(stream, b"")
        except OSError:
            with contextlib.suppress(OSError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)


def in_main_thread() -> bool:
    """Return whether this is the thread that may handle signals."""
    return threading.current_thread() is threading.main_thread()


@contextlib.contextmanager
def _handlers(wanted: Mapping[signal.Signals, _Handler]) -> Iterator[bool]:
    """Handle signals in other ways meanwhile; tell whether that is possible here."""
    if not in_main_thread():
        yield False
        return
    former = {
        number: signal.signal(number, handler)
        for number, handler in wanted.items()
        if number != _HANGUP or signal.getsignal(number) != signal.SIG_IGN
    }
    try:
        yield True
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
