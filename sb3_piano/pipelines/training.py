"""Training as a job: train a run to its end, from any checkpoint, and evaluate it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks.checkpoint import CHECKPOINT_FILE, DEFAULT_EVERY, Checkpoint
from sb3_piano.callbacks.condition import Condition
from sb3_piano.callbacks.end_when_met import EndWhenMet, read_evaluations
from sb3_piano.files import read_json, write_json, write_yaml
from sb3_piano.jobs import Job
from sb3_piano.jobs.job import Work
from sb3_piano.training import RunConfig, RunFolder, evaluate, resume, train

_ENDED, _EVALUATIONS = "ended.json", "evaluations.json"
"""Files of a training: a note that a callback ended it early, and the evaluations in it."""


def _train_and_evaluate(job: TrainingJob) -> Mapping[str, Any]:
    run, (started_at, total) = RunFolder(job.folder), job.progress()
    steps, over = started_at, {"num_timesteps": started_at, "n_timesteps": total}
    if steps and job.is_met(job.evaluations(steps)):  # by a process that was killed before
        saved = Checkpoint.read(run.checkpoint_dir)
        assert saved is not None, "it has steps"
        saved.copy_model(run.checkpoint_dir, run.model_file)
    elif _read(job.folder / _ENDED) != over:
        options = {name: getattr(job, name) for name in ("checkpoint_every", "progress_bar")}
        callback = EndWhenMet(job.until, job.folder / _EVALUATIONS)
        steps = train_to_end(job.folder, job.config, [callback], **options)
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

    def evaluations(self, until: float = math.inf) -> dict[int, Mapping[str, float]]:
        """Return each metric's mean over episodes by the step count, up to ``until`` steps."""
        return read_evaluations(self.folder / _EVALUATIONS, until)

    def is_met(self, evaluations: Mapping[int, Mapping[str, float]]) -> bool:
        """Check whether evaluations meet the job's condition."""
        return self.until is not None and self.until.is_met([*evaluations.values()])


def train_to_end(
    folder: Path, config: RunConfig, callbacks: Sequence[BaseCallback], **options: Any
) -> int:
    """Train a run, or resume it; return its steps, fewer if a callback ended it.

    An interruption raises ``KeyboardInterrupt``, after a checkpoint was saved.
    """
    if RunFolder(folder).has_begun:
        result = resume(folder, config.n_timesteps, callbacks=callbacks, **options)
    else:
        result = train(config, folder, callbacks=callbacks, **options)
    if result.interrupted:
        raise KeyboardInterrupt
    return result.num_timesteps


def _read(file: Path) -> dict[str, Any]:
    """Read a JSON file of a run; return an empty mapping if the file is missing."""
    return read_json(file, dict[str, Any], "delete it, and it is made again.") or {}
