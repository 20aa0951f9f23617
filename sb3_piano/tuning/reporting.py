"""Callbacks of a trial's trainings."""

from __future__ import annotations

import time
from collections.abc import Callable

from stable_baselines3.common.callbacks import BaseCallback


class AfterEvaluation(BaseCallback):
    """Call a function after each evaluation, and end the training if it says so.

    It is for ``callback_after_eval`` of SB3's ``EvalCallback`` and its subclasses.

    Args:
        goes_on: Is called without arguments; returns whether the training goes on.
    """

    def __init__(self, goes_on: Callable[[], bool]) -> None:
        super().__init__()
        self._goes_on = goes_on

    def _on_step(self) -> bool:
        return self._goes_on()


class TimeLimit(BaseCallback):
    """End the training when its time is over.

    Args:
        seconds: The longest that it may take.
    """

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._seconds = seconds
        self._end = 0.0

    def _on_training_start(self) -> None:
        self._end = time.monotonic() + self._seconds

    def _on_step(self) -> bool:
        return time.monotonic() < self._end
