"""Handle Ctrl-C, SIGTERM and a closed terminal at safe moments.

Python lets only the main thread handle signals; in others these contexts change nothing. A process
that ignores SIGHUP, as under ``nohup``, continues without a terminal.
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
"""Signals that a terminal sends to all its processes."""

_ENDING = (*OF_TERMINAL, signal.SIGTERM)


class StopRequest:
    """Flag that a signal sets to end the work."""

    def __init__(self) -> None:
        self.made = False


_answering: list[StopRequest] = []
"""The active request, if any."""


@contextlib.contextmanager
def stop_on_signal() -> Iterator[StopRequest]:
    """Turn the first Ctrl-C, SIGTERM or SIGHUP into a stop request; the second raises.

    A second SIGHUP does not raise: a closed terminal and its shell both send one.

    A nested block shares the request of the outer one. So no signal is lost when the inner block
    ends.

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
    """Return whether a signal set the present :class:`StopRequest`."""
    return any(request.made for request in _answering)


@contextlib.contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """Raise ``KeyboardInterrupt`` at SIGTERM and SIGHUP too, unless a handler takes them."""

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
    """Defer Ctrl-C, SIGTERM and SIGHUP until the end of the block."""
    came: list[int] = []
    with _handlers(dict.fromkeys(_ENDING, lambda number, frame: came.append(number))):
        yield
    if came:
        signal.raise_signal(came[0])


def leave_to_parent() -> None:
    """Ignore Ctrl-C and a closed terminal in this process; its parent handles them.

    A terminal sends both to all its processes.
    """
    for number in OF_TERMINAL:
        signal.signal(number, signal.SIG_IGN)


def _leave_terminal() -> None:
    """Redirect closed output streams to the null device, as printing would raise."""
    for stream in (1, 2):
        try:
            os.write(stream, b"")
        except OSError:
            with contextlib.suppress(OSError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)


def in_main_thread() -> bool:
    """Return whether this is the main thread, the only one that handles signals."""
    return threading.current_thread() is threading.main_thread()


@contextlib.contextmanager
def _handlers(wanted: Mapping[signal.Signals, _Handler]) -> Iterator[bool]:
    """Install signal handlers for the block; yield whether that is possible here."""
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
