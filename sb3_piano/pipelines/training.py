"""Training as a job: a run is trained to its end, from wherever it stopped, and evaluated."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks.checkpoint import CHECKPOINT_FILE, DEFAULT_EVERY
from sb3_piano.files import read_json, write_json, write_yaml
from sb3_piano.jobs import Job
from sb3_piano.training import RunConfig, RunFolder, evaluate, resume, train

_ENDED = "ended.json"
"""Where a run notes that a callback has ended its training before all steps were done."""

_EVALUATION = "evaluation/metrics.json"


@dataclass(frozen=True, kw_only=True)
class TrainingJob(Job):
    """A run that is to be trained, in its own folder."""

    kind: ClassVar[str] = "run"

    config: RunConfig
    """Its settings, with a seed."""

    def begin(self) -> None:
        """Note the settings in a new folder, or compare them; see :meth:`Job.begin`."""
        if RunFolder(self.folder).has_begun and not self.settings_file.is_file():
            write_yaml(self.settings_file, self.settings)  # by an older version, which noted none
        super().begin()

    def progress(self) -> tuple[int, int]:
        """Return how many environment steps are done, and how many were asked for."""
        return steps_of(self.folder), self.config.n_timesteps


def training(
    name: str,
    folder: str | os.PathLike[str],
    config: RunConfig,
    *,
    episodes: int = 1,
    checkpoint_every: int = DEFAULT_EVERY,
    progress_bar: bool = False,
    needs: Sequence[str] = (),
) -> TrainingJob:
    """Return the job of a run that is to be trained and evaluated.

    Its result has ``num_timesteps``, ``started_at`` (what the last attempt began with) and
    ``metrics``, means over the episodes that the trained model plays.

    Args:
        name: What it is called.
        folder: The run's folder.
        config: The run's settings, with a seed.
        episodes: Episodes of each of its pieces that the trained model plays.
        checkpoint_every: Environment steps between two checkpoints.
        progress_bar: Whether to show a bar of the steps.
        needs: Names of the jobs that have to be done before, such as of the run it starts from.
    """
    options = {"checkpoint_every": checkpoint_every, "progress_bar": progress_bar}
    return TrainingJob(
        name=name,
        folder=Path(folder).absolute(),
        work=_train_and_evaluate,
        settings=config.to_mapping(),
        needs=tuple(needs),
        options={"episodes": episodes, **options},
        config=config,
    )


def _train_and_evaluate(job: TrainingJob) -> Mapping[str, Any]:
    options = dict(job.options)
    episodes, total = options.pop("episodes"), job.config.n_timesteps
    started_at = steps = steps_of(job.folder)
    over = {"num_timesteps": steps, "n_timesteps": total}
    if steps < total and _read(job.folder / _ENDED) != over:
        steps, _ = train_to_end(job.folder, job.config, (), **options)
        if steps < total:
            write_json(job.folder / _ENDED, {"num_timesteps": steps, "n_timesteps": total})
    metrics = known_metrics(job.folder, job.config, steps, episodes)
    if metrics is None:
        found = evaluate(job.folder, episodes)
        if found.interrupted:
            raise KeyboardInterrupt
        metrics = found.mean
    return {"num_timesteps": steps, "started_at": started_at, "metrics": metrics}


def train_to_end(
    folder: Path, config: RunConfig, callbacks: Sequence[BaseCallback], **options: Any
) -> tuple[int, bool]:
    """Train a run, or the rest of it; return its steps, and whether a callback ended it.

    Raises:
        KeyboardInterrupt: If it was interrupted; a checkpoint is saved.
    """
    if RunFolder(folder).has_begun:
        result = resume(folder, config.n_timesteps, callbacks=callbacks, **options)
    else:
        result = train(config, folder, callbacks=callbacks, **options)
    if result.interrupted:
        raise KeyboardInterrupt
    return result.num_timesteps, result.num_timesteps < result.n_timesteps


def steps_of(folder: Path) -> int:
    """Return the environment steps that a run's last checkpoint has done; 0 without one."""
    # The file alone: those that it names may just be replaced, by who trains.
    return int(_read(RunFolder(folder).checkpoint_dir / CHECKPOINT_FILE).get("num_timesteps", 0))


def known_metrics(
    folder: Path, config: RunConfig, steps: int, episodes: int
) -> dict[str, float] | None:
    """Return the means of an evaluation that a run's folder has, if it is what is asked for.

    It has to be of so many steps, in the run's own physics, and of so many episodes of each piece.
    """
    found = _read(folder / _EVALUATION)
    if not found or found["interrupted"] or found["num_timesteps"] != steps:
        return None
    if found["env_kwargs"].get("physics") != config.env_kwargs.get("physics"):
        return None
    enough = len(found["episodes"]) >= episodes * max(len(found.get("evaluations", ())), 1)
    return dict(found["mean"]) if enough else None


def _read(file: Path) -> dict[str, Any]:
    """Return what a file of a run holds; nothing if there is none."""
    return read_json(file, dict[str, Any], "delete it, and it is made again.") or {}
