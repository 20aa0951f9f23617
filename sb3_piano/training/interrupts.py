"""Ending a training by Ctrl-C or SIGTERM at a moment when nothing is half done."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopRequest:
    """Whether someone asked the training to end."""

    def __init__(self) -> None:
        self.made = False


class StopOnRequest(BaseCallback):
    """End the training soon after a request, by raising ``KeyboardInterrupt`` between two rollouts.

    In the middle of a rollout the last step of off-policy algorithms is counted but not yet in the
    replay buffer. On-policy algorithms throw an unfinished rollout away, so they end at once.
    """

    def __init__(self, request: StopRequest) -> None:
        super().__init__()
        self._request = request

    def _on_rollout_start(self) -> None:
        if self._request.made:
            raise KeyboardInterrupt

    def _on_step(self) -> bool:
        return not (self._request.made and isinstance(self.model, OnPolicyAlgorithm))


_answering: list[StopRequest] = []
"""The request that signals make at present, if any."""


@contextlib.contextmanager
def stop_on_signal() -> Iterator[StopRequest]:
    """Turn the first Ctrl-C or SIGTERM into a request to stop; the second one raises at once.

    A block within another one has the request of that, so that none is lost when a training ends
    just then. The former handlers are back afterwards. Outside the main thread, where Python allows
    no handlers, signals do what they did before.

    Raises:
        KeyboardInterrupt: At the second signal.
    """
    if threading.current_thread() is not threading.main_thread():
        yield StopRequest()
        return
    if _answering:
        yield _answering[0]
        return
    request = StopRequest()

    def handle(number: int, frame: FrameType | None) -> None:
        del number, frame  # either signal means the same
        if request.made:
            raise KeyboardInterrupt
        request.made = True

    former = {number: signal.signal(number, handle) for number in _SIGNALS}
    _answering.append(request)
    try:
        yield request
    finally:
        _answering.clear()
        for number, handler in former.items():
            signal.signal(number, handler)
