"""Train a curriculum: a chain of jobs, each a run that starts from the previous one."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sb3_piano.callbacks.checkpoint import DEFAULT_EVERY
from sb3_piano.exceptions import ConfigError, RunError, SB3PianoError, naming
from sb3_piano.files import write_yaml
from sb3_piano.jobs import Here, Job, Outcome, finish, status
from sb3_piano.jobs.folders import is_empty, shared_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.pipelines.stages import CURRICULUM_FILE, Curriculum, load_curriculum
from sb3_piano.pipelines.training import TrainingJob
from sb3_piano.settings import Count, checked
from sb3_piano.training import RunFolder
from sb3_piano.training.runs.start import start_plugin

_SIZES = ("n_envs", "buffer_size")  # equal if a stage starts with the previous replay buffer


def run_curriculum(
    curriculum: Curriculum,
    folder: str | os.PathLike[str],
    *,
    progress_bar: bool = True,
    checkpoint_every: int = DEFAULT_EVERY,
    on_stage: Callable[[Job], object] = lambda stage: None,
) -> list[Outcome]:
    """Train the stages of a curriculum, one after the other; return the outcome of each.

    Each starts from the last model of the previous one by
    :class:`~sb3_piano.training.StartFromRun`: networks, optimizers, entropy coefficient and
    statistics of ``VecNormalize``. Step count and schedules restart.

    Ctrl-C or SIGTERM ends it: the last outcomes then have no result. The same call resumes where
    training stopped, after a crash from the last checkpoint. Finished stages are not trained again;
    stages that have not begun may be changed, removed or added. All their environments are made
    before training, so that misfits are reported at once.

    The folder gets ``curriculum.yml``, with all settings of each stage and the seed, and
    ``<n>_<name>/``, the run of stage n. The run has the stage's evaluations in ``evaluations.json``
    and, once finished, the steps and the reason of its end in ``result.json``.

    Args:
        curriculum: The stages.
        folder: Folder of the curriculum, new, empty or to be resumed.
        progress_bar: Whether to show progress on the terminal.
        checkpoint_every: Environment steps between two checkpoints.
        on_stage: Called with each stage's job before its training.

    Raises:
        ConfigError: If a setting is invalid, or a stage cannot start from the one before.
        RunError: If the folder cannot be used, or a stage that has begun has other settings.
    """
    checked("checkpoint_every", checkpoint_every, Count)
    shared_folder(folder)
    place = Path(folder)
    curriculum, begun = _with_seed(place, curriculum)
    options = {"progress_bar": progress_bar, "checkpoint_every": checkpoint_every}
    jobs = curriculum_jobs(place, curriculum, **options)
    for job in jobs[:begun]:
        job.begin()
    check_fit(curriculum, begun)
    busy = f"The curriculum in '{place}' is being trained"
    with hold(place / LOCK_SUFFIX, busy, "one process in a folder: --status for its state."):
        write_yaml(place / CURRICULUM_FILE, curriculum.to_mapping())
        try:
            runs = finish(jobs, Here(), on_begin=on_stage)
        except KeyboardInterrupt:
            runs = status(jobs)
    for run in runs:
        if run.error is not None:
            raise run.error
    return runs


def curriculum_jobs(place: Path, curriculum: Curriculum, **options: Any) -> list[TrainingJob]:
    """Create a job for each stage; each needs the previous one."""
    jobs: list[TrainingJob] = []
    names = ("algo", "seed", "init_from")
    shared = {name: v for name in names if (v := getattr(curriculum, name)) is not None}
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
    if place.is_dir() and not (file.is_file() or is_empty(place)):
        raise RunError(
            f"Folder '{place}' is not empty, and holds no curriculum of this version: expected a "
            "new or empty folder (--out), to go on from an older one's last stage with init_from."
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
    """Raise ``ConfigError`` if a stage that has not begun cannot start from the one before."""
    before: dict[str, Any] = {}
    stages = list(enumerate(curriculum.stages, start=1))
    for number, stage in stages[max(begun - 1, 0) :] if begun < len(stages) else ():
        with naming(f"Stage {number}", SB3PianoError):
            config = stage.run_config(curriculum.algo)
            with contextlib.closing(config.env.make()) as env:
                now = {n: getattr(env, n) for n in ("observation_space", "action_space")}
            now["normalize"] = config.normalize is not False
            now |= {n: {**config.algorithm_kwargs, "n_envs": config.n_envs}.get(n) for n in _SIZES}
            for name, value in now.items():
                counts = stage.with_buffer or name not in _SIZES
                if counts and before.get(name, value) != value:
                    raise ConfigError(
                        f"Its {name} is {value}, that of the stage before {before[name]}: "
                        "expected equal values. Use the same wrappers and an observation that does "
                        "not depend on the piece, such as 'roll'; for sizes, or no with_buffer."
                    )
            before = now
