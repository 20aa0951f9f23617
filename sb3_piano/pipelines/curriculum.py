"""Train a curriculum: a chain of jobs, each a run that starts from the previous one."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sb3_piano.callbacks.checkpoint import DEFAULT_EVERY
from sb3_piano.exceptions import ConfigError, RunError, SB3PianoError, naming
from sb3_piano.files import write_yaml
from sb3_piano.jobs import Here, Job
from sb3_piano.jobs.folders import is_empty, shared_folder, unwritable
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.pipelines.stages import CURRICULUM_FILE, Curriculum, load_curriculum
from sb3_piano.pipelines.training import Trained, TrainingJob, train_all
from sb3_piano.settings import Count, checked
from sb3_piano.training import RunFolder
from sb3_piano.training.runs.start import start_plugin

_FORMER = "curriculum.json"
"""File of earlier versions."""

_SIZES = ("n_envs", "buffer_size")
"""Settings that must be equal if a stage starts with the previous replay buffer."""


def run_curriculum(
    curriculum: Curriculum,
    folder: str | os.PathLike[str] | None = None,
    *,
    runs_dir: str | os.PathLike[str] = "runs",
    seed: int | None = None,
    progress_bar: bool = True,
    checkpoint_every: int = DEFAULT_EVERY,
    on_stage: Callable[[Job], object] = lambda stage: None,
) -> Trained:
    """Train the stages of a curriculum, one after the other.

    Each starts from the last model of the previous one by
    :class:`~sb3_piano.training.StartFromRun`: networks, optimizers, entropy coefficient and
    statistics of ``VecNormalize``. Step count and schedules restart.

    The same call resumes: after Ctrl-C or SIGTERM where training stopped, after a crash from the
    last checkpoint. Finished stages are not trained again; stages that have not begun may be
    changed, removed or added. All their environments are made before training, so that misfits are
    reported at once.

    The folder gets ``curriculum.yml``, with all settings of each stage and the seed, and
    ``<n>_<name>/``, the run of stage n. The run has the stage's evaluations in ``evaluations.json``
    and, once finished, the steps and the reason of its end in ``result.json``.

    Args:
        curriculum: The stages.
        folder: Folder of the curriculum, new, empty or to be resumed; by default
            ``<runs_dir>/curricula/<name>``.
        runs_dir: Parent folder of runs.
        seed: Seed of each stage, instead of the curriculum's; without either, one is drawn.
        progress_bar: Whether to show progress on the terminal.
        checkpoint_every: Environment steps between two checkpoints.
        on_stage: Called with each stage's job before its training.

    Raises:
        ConfigError: If a setting is invalid, or a stage cannot start from the one before.
        RunError: If the folder cannot be used, or a stage that has begun has other settings.
    """
    checked("checkpoint_every", checkpoint_every, Count)
    if seed is not None:
        curriculum = dataclasses.replace(curriculum, seed=seed)
    place = Path(runs_dir, "curricula", curriculum.name) if folder is None else Path(folder)
    shared_folder(folder or place)
    curriculum, begun = _with_seed(place, curriculum)
    jobs = curriculum_jobs(
        place, curriculum, progress_bar=progress_bar, checkpoint_every=checkpoint_every
    )
    for job in jobs[:begun]:
        job.begin()
    check_fit(curriculum, begun)
    busy = f"The curriculum in '{place}' is being trained"
    expected = "one process in a folder. Wait for its end or stop it; then resume with: "
    with hold(place / LOCK_SUFFIX, busy, expected + resume_command(place)):
        try:
            write_yaml(place / CURRICULUM_FILE, curriculum.to_mapping())
        except OSError as error:
            raise unwritable(place, error) from error
        result = train_all(place, jobs, executor=Here(), on_begin=on_stage)
    for run in result.runs:
        if run.error is not None:
            raise run.error
    return result


def curriculum_jobs(place: Path, curriculum: Curriculum, **options: Any) -> list[TrainingJob]:
    """Create a job for each stage; each needs the previous one."""
    jobs: list[TrainingJob] = []
    shared = {name: getattr(curriculum, name) for name in ("algo", "seed", "init_from")}
    shared = {name: value for name, value in shared.items() if value is not None}
    start = curriculum.init_from
    for name, stage in zip(curriculum.run_names, curriculum.stages, strict=True):
        with naming(f"Stage {len(jobs) + 1}", SB3PianoError):
            config = dataclasses.replace(stage.run_config(curriculum.algo), seed=curriculum.seed)
        if start is not None:
            plugin = start_plugin(start, stage.with_buffer, stage.with_entropy)
            config = dataclasses.replace(config, callback=(*config.callback, plugin))
        job = TrainingJob(
            name=name,
            folder=place / name,
            config=config,
            episodes=0,
            until=stage.until,
            settings=shared | stage.to_mapping(),
            needs=tuple(job.name for job in jobs[-1:]),
            **options,
        )
        jobs.append(job)
        start = str(place / name)
    return jobs


def _with_seed(place: Path, curriculum: Curriculum) -> tuple[Curriculum, int]:
    """Return a curriculum with its folder's seed, and the number of stages begun there."""
    file = place / CURRICULUM_FILE
    if (place / _FORMER).is_file():
        raise RunError(
            f"The curriculum in '{place}' was begun by an older version: expected another folder "
            "(--out), with init_from its last stage. Its stages are runs like all others."
        )
    if place.is_dir() and not (file.is_file() or is_empty(place)):
        raise RunError(
            f"Folder '{place}' is not empty, and holds no curriculum: expected a new or empty "
            "folder, or a curriculum's."
        )
    begun = sorted(path.name for path in place.glob("*_*") if RunFolder(path).has_begun)
    for name in begun:
        if name not in curriculum.run_names:
            raise RunError(
                f"Stage {name.partition('_')[0]} of the curriculum in '{place}' has begun as "
                f"{name!r}: expected the same stage, or another folder (--out). Only stages that "
                "have not begun may change."
            )
    seed = curriculum.seed
    if seed is None and file.is_file():
        seed = load_curriculum(place).seed
    if seed is None:
        seed = int(np.random.default_rng().integers(2**31))
    return dataclasses.replace(curriculum, seed=seed), len(begun)


def check_fit(curriculum: Curriculum, begun: int = 0) -> None:
    """Check the environments of the stages that have not begun, and of the last begun one.

    Raises:
        ConfigError: If a setting is invalid, or a stage cannot start from the one before.
    """
    before: dict[str, Any] = {}
    stages = list(enumerate(curriculum.stages, start=1))
    for number, stage in stages[max(begun - 1, 0) :] if begun < len(stages) else ():
        with naming(f"Stage {number}", SB3PianoError):
            config = stage.run_config(curriculum.algo)
            with contextlib.closing(config.env.make()) as env:
                ours = {n: getattr(env, n) for n in ("observation_space", "action_space")}
            ours["normalize"] = config.normalize is not False
            sizes = {n: {**config.algorithm_kwargs, "n_envs": config.n_envs}.get(n) for n in _SIZES}
            now = {**ours, **sizes}
            compared = now if stage.with_buffer else ours
            for name in compared if before else ():
                if before[name] != now[name]:
                    raise ConfigError(
                        f"Its {name} is {now[name]}, that of the stage before {before[name]}: "
                        "expected equal values. Use the same wrappers and an observation that does "
                        "not depend on the piece, such as 'roll'; for sizes, or no with_buffer."
                    )
            before = now


def resume_command(place: Path) -> str:
    """Return the command that resumes a curriculum."""
    return f"sb3-piano curriculum --resume {shlex.quote(str(place))}"
