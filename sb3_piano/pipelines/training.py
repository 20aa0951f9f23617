"""Training as a job: train a run to its end, from any checkpoint, and evaluate it."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import MetricEvalCallback
from sb3_piano.callbacks.checkpoint import CHECKPOINT_FILE, DEFAULT_EVERY, Checkpoint
from sb3_piano.callbacks.condition import Condition
from sb3_piano.callbacks.own_env import with_nested
from sb3_piano.exceptions import ConfigError
from sb3_piano.files import read_json, write_json, write_yaml
from sb3_piano.jobs import Job, Outcome, finish, status
from sb3_piano.jobs.job import Work
from sb3_piano.training import RunConfig, RunFolder, evaluate, resume, train

_ENDED = "ended.json"
"""File that records that a callback ended a training early."""

_EVALUATIONS = "evaluations.json"
"""File of the evaluations during a training."""


@dataclass(frozen=True, kw_only=True)
class TrainingEvaluation:
    """Evaluation during a training: step count, and each metric's mean over episodes."""

    num_timesteps: int
    metrics: Mapping[str, float]


def _train_and_evaluate(job: TrainingJob) -> Mapping[str, Any]:
    run, (started_at, total) = RunFolder(job.folder), job.progress()
    steps, over = started_at, {"num_timesteps": started_at, "n_timesteps": total}
    if steps and job.is_met(job.evaluations(steps)):  # by a process that was killed before
        saved = Checkpoint.read(run.checkpoint_dir)
        assert saved is not None, "it has steps"
        saved.copy_model(run.checkpoint_dir, run.model_file)
    elif _read(job.folder / _ENDED) != over:
        options = {name: getattr(job, name) for name in ("checkpoint_every", "progress_bar")}
        steps = train_to_end(job.folder, job.config, [_EndWhenMet(job)], **options)
        if steps < total:
            write_json(job.folder / _ENDED, {**over, "num_timesteps": steps})
    met = job.is_met(job.evaluations(steps))
    ended_by = "condition" if met else "budget" if steps >= total else "callback"
    ended = {"num_timesteps": steps, "started_at": started_at, "ended_by": ended_by}
    if not job.episodes:
        return ended
    judged = evaluate(job.folder, job.episodes)
    if judged.interrupted:
        raise KeyboardInterrupt
    return {**ended, "metrics": judged.mean}


@dataclass(frozen=True, kw_only=True)
class TrainingJob(Job):
    """Job that trains and evaluates a run.

    Its result has ``num_timesteps``, ``started_at`` (steps at the start of the last attempt),
    ``ended_by`` (``budget``, ``condition`` or ``callback``) and ``metrics``, means over the
    episodes of the trained model. By default its settings are the config's.
    """

    kind: ClassVar[str] = "run"

    work: Work = _train_and_evaluate
    config: RunConfig
    """Settings of the run, with a seed."""
    until: Condition | None = None
    """Condition that ends it before all its steps; it uses the config's callbacks."""
    episodes: int = 1
    """Episodes of each piece for the trained model's evaluation; 0 for no evaluation."""
    checkpoint_every: int = DEFAULT_EVERY
    """Environment steps between two checkpoints."""
    progress_bar: bool = False
    """Whether to show a progress bar."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "folder", Path(self.folder).absolute())
        if not self.settings:
            object.__setattr__(self, "settings", self.config.to_mapping())

    def begin(self) -> None:
        """Write the settings into a new folder, or compare them; see :meth:`Job.begin`."""
        if RunFolder(self.folder).has_begun and not self.has_begun():
            write_yaml(self.settings_file, self.settings)  # by an older version, which wrote none
        super().begin()

    def progress(self) -> tuple[int, int]:
        """Return the numbers of environment steps done and in total."""
        # The file alone: a training may just be replacing the files that it names.
        saved = _read(RunFolder(self.folder).checkpoint_dir / CHECKPOINT_FILE)
        return int(saved.get("num_timesteps", 0)), self.config.n_timesteps

    def evaluations(self, until: int | None = None) -> tuple[TrainingEvaluation, ...]:
        """Return the training's evaluations up to ``until`` steps, or all.

        Raises:
            RunError: If the file is damaged.
        """
        again = "delete it: the run is then evaluated anew."
        kind = dict[str, tuple[TrainingEvaluation, ...]]
        found = (read_json(self.folder / _EVALUATIONS, kind, again) or {}).get("evaluations", ())
        return tuple(one for one in found if until is None or one.num_timesteps <= until)

    def is_met(self, evaluations: Sequence[TrainingEvaluation]) -> bool:
        """Check whether evaluations meet the job's condition."""
        return self.until is not None and self.until.is_met([one.metrics for one in evaluations])


@dataclass(frozen=True, kw_only=True)
class Trained:
    """Result of a sweep or a curriculum."""

    folder: Path
    """Folder of the sweep or curriculum."""
    runs: tuple[Outcome, ...]
    """Outcomes of the runs, in the order of the grid or of the stages."""
    interrupted: bool = False
    """Whether Ctrl-C or SIGTERM ended it early."""
    had_finished: bool = False
    """Whether all runs had finished before."""


def train_all(
    folder: Path,
    jobs: Sequence[TrainingJob],
    on_result: Callable[[Outcome, int, int], object] = lambda outcome, done, total: None,
    note: Callable[[Sequence[Outcome]], object] = lambda runs: None,
    **options: Any,
) -> Trained:
    """Finish jobs with :func:`~sb3_piano.jobs.finish`; call ``note`` with all at each change.

    An interruption sets ``interrupted`` of the result.
    """
    known = status(jobs)
    runs = {one.job.name: one for one in known}

    def tell(outcome: Outcome, done: int, total: int) -> None:
        runs[outcome.job.name] = outcome
        note(list(runs.values()))
        on_result(outcome, done, total)

    note(known)
    interrupted, had_finished = False, all(one.result is not None for one in known)
    try:
        finish(jobs, known=known, on_outcome=tell, **options)
    except KeyboardInterrupt:
        interrupted = True
    found = tuple(runs.values())
    return Trained(folder=folder, runs=found, interrupted=interrupted, had_finished=had_finished)


def train_to_end(
    folder: Path, config: RunConfig, callbacks: Sequence[BaseCallback], **options: Any
) -> int:
    """Train a run, or resume it; return its steps, fewer if a callback ended it.

    Raises:
        KeyboardInterrupt: If it was interrupted; a checkpoint is saved.
    """
    if RunFolder(folder).has_begun:
        result = resume(folder, config.n_timesteps, callbacks=callbacks, **options)
    else:
        result = train(config, folder, callbacks=callbacks, **options)
    if result.interrupted:
        raise KeyboardInterrupt
    return result.num_timesteps


class _EndWhenMet(BaseCallback):
    """Save the evaluations of a training's callbacks; end it once they meet its condition."""

    def __init__(self, job: TrainingJob) -> None:
        super().__init__()
        self._job = job
        self._evaluations: list[TrainingEvaluation] = []

    def _on_training_start(self) -> None:
        begun = self.num_timesteps > 0  # else it starts over
        self._evaluations = [*self._job.evaluations(self.num_timesteps)] if begun else []
        self._keep()
        self._on_step()

    def _on_step(self) -> bool:
        last = self._evaluations[-1].num_timesteps if self._evaluations else -1
        found: dict[int, dict[str, float]] = defaultdict(dict)
        for callback in with_nested([self.locals["callback"]]):
            if isinstance(callback, MetricEvalCallback):
                for number, steps in enumerate(callback.evaluated_at):
                    if steps > last:
                        found[steps] |= callback.means(number)
        for steps, metrics in sorted(found.items()):
            for name in self._job.until.thresholds if self._job.until is not None else ():
                if name not in metrics:
                    raise ConfigError(
                        f"until asks for {name!r}, which the evaluations do not have: "
                        f"expected one of {', '.join(sorted(metrics))}."
                    )
            self._evaluations.append(TrainingEvaluation(num_timesteps=steps, metrics=metrics))
        if found:
            self._keep()
        return not self._job.is_met(self._evaluations)

    def _keep(self) -> None:
        noted = {"evaluations": list(map(dataclasses.asdict, self._evaluations))}
        write_json(self._job.folder / _EVALUATIONS, noted)


def _read(file: Path) -> dict[str, Any]:
    """Read a JSON file of a run; return an empty mapping if the file is missing."""
    return read_json(file, dict[str, Any], "delete it, and it is made again.") or {}
