"""End a training once its evaluations, which a file keeps, meet a condition."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks.condition import Condition
from sb3_piano.callbacks.metric_eval import MetricEvalCallback
from sb3_piano.callbacks.own_env import with_nested
from sb3_piano.files import read_json, write_json
from sb3_piano.settings import refuse_unknown

Evaluations = dict[int, Mapping[str, float]]
"""Each metric's mean over episodes, by the step count of the evaluation."""


def read_evaluations(file: Path, until: float = math.inf) -> Evaluations:
    """Return the evaluations in a file of :class:`EndWhenMet`, up to ``until`` steps."""
    again = "delete it: the run is then evaluated anew."
    found = read_json(file, dict[str, list[dict[str, Any]]], again) or {}
    pairs = ((one["num_timesteps"], one["metrics"]) for one in found.get("evaluations", ()))
    return {steps: metrics for steps, metrics in pairs if steps <= until}


class EndWhenMet(BaseCallback):
    """Save the evaluations of a training's callbacks; end it once they meet a condition.

    They are those of every :class:`MetricEvalCallback` of the training. A training that is resumed
    goes on with the saved ones.
    """

    def __init__(self, until: Condition | None, file: Path) -> None:
        super().__init__()
        self._until, self._file = until, file
        self._evaluations: Evaluations = {}

    def _on_training_start(self) -> None:
        if self.num_timesteps > 0:  # else it starts over
            self._evaluations = read_evaluations(self._file, self.num_timesteps)
        self._keep()
        self._on_step()

    def _on_step(self) -> bool:
        last = max(self._evaluations, default=-1)
        found: dict[int, dict[str, float]] = defaultdict(dict)
        for callback in with_nested([self.locals["callback"]]):
            if isinstance(callback, MetricEvalCallback):
                for number, steps in enumerate(callback.evaluated_at):
                    if steps > last:
                        found[steps] |= callback.means(number)
        for steps, metrics in sorted(found.items()):
            if self._until is not None:
                refuse_unknown(self._until.thresholds, metrics, "metric", "until")
            self._evaluations[steps] = metrics
        if found:
            self._keep()
        return self._until is None or not self._until.is_met([*self._evaluations.values()])

    def _keep(self) -> None:
        pairs = self._evaluations.items()
        noted = [{"num_timesteps": steps, "metrics": metrics} for steps, metrics in pairs]
        write_json(self._file, {"evaluations": noted})
