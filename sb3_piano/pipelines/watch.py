"""The evaluations of a stage, and the end of its training once they meet its condition."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import Condition, MetricEvalCallback
from sb3_piano.callbacks.own_env import with_nested
from sb3_piano.exceptions import ConfigError
from sb3_piano.files import read_json, write_json

_FILE = "evaluations.json"
_ALWAYS_NOTED = ("f1", "onset_f1")


@dataclass(frozen=True, kw_only=True)
class StageEvaluation:
    """Evaluation in the training of a stage."""

    num_timesteps: int
    """Environment steps that the stage's model was trained for."""
    metrics: Mapping[str, float]
    """F1, onset F1 and the metrics of the stage's condition, by name; means over episodes."""


def read_evaluations(folder: Path, until: int | None = None) -> tuple[StageEvaluation, ...]:
    """Return the evaluations of the stage in a folder, of its first ``until`` steps or all.

    Raises:
        RunError: If the file is damaged.
    """
    again = "delete it: the stage is then evaluated anew."
    noted = read_json(folder / _FILE, dict[str, tuple[StageEvaluation, ...]], again) or {}
    found = noted.get("evaluations", ())
    return tuple(one for one in found if until is None or one.num_timesteps <= until)


class EndWhenMet(BaseCallback):
    """End a training once its evaluations meet a condition; they are kept in the run's folder.

    They are those of the training's :class:`~sb3_piano.callbacks.MetricEvalCallback`.

    Args:
        until: The condition, if there is one.
        folder: The run's folder.
    """

    def __init__(self, until: Condition | None, folder: Path) -> None:
        super().__init__()
        self._until, self._folder = until, folder
        self.evaluations: tuple[StageEvaluation, ...] = ()
        """The evaluations so far, also those of before the training was resumed."""

    def is_met(self, evaluations: Iterable[StageEvaluation]) -> bool:
        """Return whether evaluations meet the condition."""
        return self._until is not None and self._until.is_met([one.metrics for one in evaluations])

    def note(self, evaluations: Iterable[StageEvaluation]) -> None:
        """Keep evaluations in the folder."""
        self.evaluations = tuple(evaluations)
        noted = {"evaluations": list(map(dataclasses.asdict, self.evaluations))}
        write_json(self._folder / _FILE, noted)

    def _on_training_start(self) -> None:
        begun = self.num_timesteps > 0  # else it starts over
        self.note(read_evaluations(self._folder, self.num_timesteps) if begun else ())
        self._collect()

    def _on_step(self) -> bool:
        self._collect()
        return not self.is_met(self.evaluations)

    def _collect(self) -> None:
        last = self.evaluations[-1].num_timesteps if self.evaluations else -1
        found: dict[int, dict[str, float]] = {}
        for callback in with_nested([self.locals["callback"]]):
            if isinstance(callback, MetricEvalCallback):
                for number, steps in enumerate(callback.evaluated_at):
                    if steps > last:
                        found.setdefault(steps, {}).update(callback.means(number))
        if found:
            new = (self._evaluation(steps, metrics) for steps, metrics in sorted(found.items()))
            self.note((*self.evaluations, *new))

    def _evaluation(self, steps: int, metrics: Mapping[str, float]) -> StageEvaluation:
        asked = () if self._until is None else tuple(self._until.thresholds)
        for name in asked:
            if name not in metrics:
                raise ConfigError(
                    f"until asks for {name!r}, which the evaluations do not have, but "
                    f"{', '.join(sorted(metrics))}: expected a metric that the piece has."
                )
        names = dict.fromkeys((*_ALWAYS_NOTED, *asked))
        kept = {name: metrics[name] for name in names if name in metrics}
        return StageEvaluation(num_timesteps=steps, metrics=kept)
