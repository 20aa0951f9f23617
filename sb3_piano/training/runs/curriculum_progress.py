"""Progress of a curriculum: what its stages were evaluated to, and how they ended."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter

from sb3_piano.exceptions import ConfigError
from sb3_piano.files import read_json, write_json
from sb3_piano.training.runs.curriculum_config import Condition

_ALWAYS_NOTED = ("f1", "onset_f1")
_EVALUATED = "eval/"


@dataclass(frozen=True, kw_only=True)
class StageEvaluation:
    """Evaluation in the training of a stage."""

    num_timesteps: int
    """Environment steps that the stage's model was trained for."""
    metrics: Mapping[str, float]
    """F1, onset F1 and the metrics of the stage's condition, by name; means over episodes."""


@dataclass(frozen=True, kw_only=True)
class StageProgress:
    """Progress of a stage."""

    name: str
    """Name of its run's folder in that of the curriculum."""
    num_timesteps: int = 0
    """Environment steps that were done when it ended, or was last evaluated or interrupted."""
    ended_by: Literal["budget", "condition", "callback"] | None = None
    """Reason of its end: its ``n_timesteps`` are done, its condition is met, or another callback
    ended its training; ``None`` before that."""
    evaluations: tuple[StageEvaluation, ...] = ()
    """Its evaluations, the oldest first."""


@dataclass(frozen=True)
class Notes:
    """Content of ``curriculum.json``: the stages that have been evaluated or have ended."""

    stages: tuple[StageProgress, ...] = ()

    @classmethod
    def read(cls, file: Path) -> Notes:
        """Return what is noted in a file; nothing if there is none.

        Raises:
            RunError: If the file is damaged.
        """
        return read_json(file, cls, "expected the file that a curriculum wrote, or none.") or cls()

    def of(self, name: str) -> StageProgress:
        """Return the progress of the stage of a name."""
        return next((s for s in self.stages if s.name == name), StageProgress(name=name))

    def write(self, file: Path, changed: StageProgress) -> None:
        """Write the notes into a file, with one stage's as they are now."""
        others = tuple(stage for stage in self.stages if stage.name != changed.name)
        write_json(file, dataclasses.asdict(Notes((*others, changed))))


class StageWatch(BaseCallback):
    """Note the evaluations of a stage, and end its training when they meet its condition."""

    def __init__(
        self,
        until: Condition | None,
        evaluations: Sequence[StageEvaluation],
        note: Callable[[tuple[StageEvaluation, ...], int, bool], None],
    ) -> None:
        super().__init__()
        self._until = until
        self._evaluations = list(evaluations)
        self._note = note
        names = () if until is None else until.thresholds
        self._log = _EvaluationLog(dict.fromkeys((*_ALWAYS_NOTED, *names)))

    def _init_callback(self) -> None:
        # Before the training starts, when other callbacks may evaluate for the first time.
        self.logger.output_formats.append(self._log)

    def _on_step(self) -> bool:
        new, self._log.found = self._log.found, {}
        if not new:
            return True
        for steps, metrics in sorted(new.items()):
            self._check(metrics)
            self._evaluations.append(StageEvaluation(num_timesteps=steps, metrics=metrics))
        values = [evaluation.metrics for evaluation in self._evaluations]
        met = self._until is not None and self._until.is_met(values)
        self._note(tuple(self._evaluations), self.num_timesteps, met)
        return not met

    def _check(self, metrics: Mapping[str, float]) -> None:
        for name in () if self._until is None else self._until.thresholds:
            if name not in metrics:
                raise ConfigError(
                    f"until asks for {name!r}, which the evaluations do not have, but "
                    f"{', '.join(sorted(metrics))}: expected a metric that the piece has."
                )


class _EvaluationLog(KVWriter):
    """Output of a logger that keeps metrics of evaluations, by environment steps."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = tuple(names)
        self.found: dict[int, dict[str, float]] = {}
        """What was logged."""

    def write(
        self,
        key_values: dict[str, Any],
        key_excluded: dict[str, tuple[str, ...]],
        step: int = 0,
    ) -> None:
        """Take what is logged at a step."""
        del key_excluded  # which is for outputs of other kinds
        logged = {name: key_values.get(f"{_EVALUATED}{name}") for name in self._names}
        metrics = {name: float(value) for name, value in logged.items() if value is not None}
        if metrics:
            self.found[step] = metrics

    def close(self) -> None:
        """Do nothing: no file is open."""
