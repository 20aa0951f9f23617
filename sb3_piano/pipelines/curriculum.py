"""A curriculum: a chain of jobs, each a run that starts from the one before."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from sb3_piano.callbacks import Checkpoint
from sb3_piano.callbacks.checkpoint import DEFAULT_EVERY
from sb3_piano.exceptions import RunError
from sb3_piano.files import read_json, write_json, write_yaml
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Here, Job, finish, is_empty
from sb3_piano.jobs.folders import shared_folder, unwritable
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.pipelines.fit import check_fit
from sb3_piano.pipelines.stages import CURRICULUM_FILE, Curriculum, Stage, load_curriculum
from sb3_piano.pipelines.training import steps_of, train_to_end
from sb3_piano.pipelines.watch import EndWhenMet, StageEvaluation, read_evaluations
from sb3_piano.settings import Count, checked
from sb3_piano.training import RunConfig, RunFolder
from sb3_piano.training.runs.start import start_plugin

_FORMER = "curriculum.json"
"""File in which former versions noted evaluations and ends of stages."""


@dataclass(frozen=True, kw_only=True)
class StageProgress:
    """Progress of a stage."""

    name: str
    """Name of its run's folder in that of the curriculum."""
    num_timesteps: int = 0
    """Environment steps that were done when it ended, or was last saved."""
    ended_by: Literal["budget", "condition", "callback"] | None = None
    """Reason of its end: its ``n_timesteps`` are done, its condition is met, or another callback
    ended its training; ``None`` before that."""
    evaluations: tuple[StageEvaluation, ...] = ()
    """Its evaluations, the oldest first."""


@dataclass(frozen=True, kw_only=True)
class CurriculumResult:
    """Result of :func:`run_curriculum`."""

    folder: Path
    """Folder of all files."""
    stages: tuple[StageProgress, ...]
    """Progress of each stage."""
    had_finished: bool = False
    """Whether there was nothing left to do."""

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C or SIGTERM ended it early."""
        return any(stage.ended_by is None for stage in self.stages)

    @property
    def runs(self) -> tuple[RunFolder, ...]:
        """Folders of the stages' runs, also of those that have not begun."""
        return tuple(RunFolder(self.folder / stage.name) for stage in self.stages)


@dataclass(frozen=True, kw_only=True)
class StageJob(Job):
    """A stage, whose run is in the job's folder."""

    kind: ClassVar[str] = "stage"

    stage: Stage
    algo: str
    seed: int
    start: Path | None
    """The run that it starts from."""

    def progress(self) -> tuple[int, int]:
        """Return how many environment steps are done, and how many were asked for."""
        return steps_of(self.folder), self.stage.run_config(self.algo).n_timesteps

    def config(self) -> RunConfig:
        """Return the settings of its run, with its seed and its start."""
        config = dataclasses.replace(self.stage.run_config(self.algo), seed=self.seed)
        if self.start is None:
            return config
        plugin = start_plugin(self.start, self.stage.with_buffer, self.stage.with_entropy)
        return dataclasses.replace(config, callback=(*config.callback, plugin))


def run_curriculum(
    curriculum: Curriculum,
    folder: str | os.PathLike[str] | None = None,
    *,
    runs_dir: str | os.PathLike[str] = "runs",
    seed: int | None = None,
    progress_bar: bool = True,
    checkpoint_every: int = DEFAULT_EVERY,
    on_stage: Callable[[StageProgress], object] = lambda stage: None,
) -> CurriculumResult:
    """Train the stages of a curriculum, one after the other.

    Each starts from the last model of the one before by
    :class:`~sb3_piano.training.StartFromRun`: networks, optimizers, entropy coefficient and
    statistics of ``VecNormalize``. Step count and schedules begin anew.

    The same call goes on with a curriculum that was begun in the folder: after Ctrl-C or SIGTERM
    where it stopped, after a crash from the last checkpoint. A stage that has ended is not trained
    again; stages that have not begun may be changed, left out or added.

    =================== ==========================================================================
    ``curriculum.yml``  the curriculum, each stage with all its settings, and the seed
    ``<n>_<name>/``     the run of stage n, from 1 on, as :func:`~sb3_piano.training.train` makes
                        it, with the stage's evaluations in ``evaluations.json`` and, once it has
                        ended, after how many steps and why in ``result.json``
    =================== ==========================================================================

    Args:
        curriculum: The stages. The environments of those that have not begun are made before any of
            them is trained, so that what does not fit is told at once.
        folder: The curriculum's folder, new, empty or one to go on in; by default
            ``<runs_dir>/curricula/<name>``.
        runs_dir: Where runs are kept.
        seed: Seed of each stage, in place of the curriculum's; without either, one is drawn.
        progress_bar: Whether to show progress on the terminal.
        checkpoint_every: Environment steps between two checkpoints.
        on_stage: Is called with each stage before it is trained.

    Raises:
        ConfigError: If a setting is invalid, or a stage cannot start from the one before.
        RunError: If the folder cannot be used, or a stage that has begun has other settings.
    """
    checked("checkpoint_every", checkpoint_every, Count)
    if seed is not None:
        curriculum = dataclasses.replace(curriculum, seed=seed)
    place = Path(runs_dir, "curricula", curriculum.name) if folder is None else Path(folder)
    shared_folder(folder or place)
    options = {"progress_bar": progress_bar, "checkpoint_every": checkpoint_every}
    with _owned(place), stop_on_signal():
        jobs = _begin(place, curriculum, options)
        had_finished = all(job.result() is not None for job in jobs)
        with contextlib.suppress(KeyboardInterrupt):  # which the result tells
            outcomes = finish(jobs, Here(), on_begin=lambda job: on_stage(_progress(job)))
            for outcome in outcomes:
                if outcome.error is not None:
                    raise outcome.error
    stages = tuple(map(_progress, jobs))
    return CurriculumResult(folder=place, stages=stages, had_finished=had_finished)


def curriculum_status(folder: str | os.PathLike[str]) -> list[StageProgress]:
    """Return how far each stage of a curriculum is, also while it is trained."""
    place = Path(folder)
    return [_progress(job) for job in _jobs(place, load_curriculum(place), {})]


def _jobs(place: Path, curriculum: Curriculum, options: Mapping[str, Any]) -> list[StageJob]:
    """Return a job for each stage; it needs the one before."""
    jobs: list[StageJob] = []
    start = None if curriculum.init_from is None else Path(curriculum.init_from)
    shared = {"algo": curriculum.algo, "seed": curriculum.seed, "init_from": curriculum.init_from}
    for name, stage in zip(curriculum.run_names, curriculum.stages, strict=True):
        jobs.append(
            StageJob(
                name=name,
                folder=place / name,
                work=_train_stage,
                settings={n: v for n, v in shared.items() if v is not None} | stage.to_mapping(),
                needs=tuple(job.name for job in jobs[-1:]),
                options=options,
                stage=stage,
                algo=curriculum.algo,
                seed=curriculum.seed or 0,
                start=start,
            )
        )
        start = place / name
    return jobs


def _train_stage(job: StageJob) -> Mapping[str, Any]:
    """Train a stage to its end: all its steps, or its condition."""
    steps, run = steps_of(job.folder), RunFolder(job.folder)
    watch = EndWhenMet(job.stage.until, job.folder)
    if steps and watch.is_met(read_evaluations(job.folder, steps)):
        saved = Checkpoint.read(run.checkpoint_dir)
        assert saved is not None, "it has steps"
        saved.copy_model(run.checkpoint_dir, run.model_file)  # by a process that was killed before
        return {"num_timesteps": steps, "ended_by": "condition"}
    steps, early = train_to_end(job.folder, job.config(), [watch], **job.options)
    ended = "condition" if watch.is_met(watch.evaluations) else "callback" if early else "budget"
    return {"num_timesteps": steps, "ended_by": ended}


def _progress(job: Job) -> StageProgress:
    """Return what is known of a stage by its folder."""
    found = job.result()
    steps = steps_of(job.folder) if found is None else found["num_timesteps"]
    ended_by = None if found is None else found["ended_by"]
    evaluations = read_evaluations(job.folder, None if found is None else steps)
    return StageProgress(
        name=job.name, num_timesteps=steps, ended_by=ended_by, evaluations=evaluations
    )


def _begin(place: Path, curriculum: Curriculum, options: Mapping[str, Any]) -> list[StageJob]:
    """Write a curriculum that fits into its folder; return its stages."""
    file = place / CURRICULUM_FILE
    # Those that are read from the file begin at its folder.
    curriculum = Curriculum.from_mapping(curriculum.to_mapping(), Path.cwd())
    begun = 0
    if file.is_file():
        stored = load_curriculum(place)
        _adopt_former(place, _jobs(place, stored, {}))
        names = [name for name in stored.run_names if RunFolder(place / name).has_begun]
        begun = len(names)
        if curriculum.seed is None:
            curriculum = dataclasses.replace(curriculum, seed=stored.seed)
        for index, name in enumerate(names):
            if name not in curriculum.run_names[index : index + 1]:
                raise RunError(
                    f"Stage {index + 1} of the curriculum in '{place}' has begun as {name!r}: "
                    "expected the same stage, or another folder (--run). Only stages that have not "
                    "begun may change."
                )
    elif not is_empty(place):
        raise RunError(
            f"Folder '{place}' is not empty, and holds no curriculum: expected a new or empty "
            "folder, or that of a curriculum."
        )
    if curriculum.seed is None:
        drawn = int(np.random.default_rng().integers(2**31))
        curriculum = dataclasses.replace(curriculum, seed=drawn)
    jobs = _jobs(place, curriculum, options)
    for job in jobs[:begun]:
        job.begin()
    if begun < len(jobs):
        check_fit(curriculum, begun)
    try:
        write_yaml(file, curriculum.to_mapping())
    except OSError as error:
        raise unwritable(place, error) from error
    return jobs


def _adopt_former(place: Path, jobs: Sequence[StageJob]) -> None:
    """Take over the stages of a folder in which a former version began."""
    expected = "expected the file that a curriculum wrote."
    noted = read_json(place / _FORMER, dict[str, tuple[StageProgress, ...]], expected) or {}
    by_name = {stage.name: stage for stage in noted.get("stages", ())}
    for job in jobs:
        run = RunFolder(job.folder)
        if not run.has_begun or job.settings_file.is_file():
            continue
        stage = by_name.get(job.name, StageProgress(name=job.name))
        EndWhenMet(None, job.folder).note(stage.evaluations)
        saved = steps_of(job.folder) if run.checkpoint_dir.is_dir() else stage.num_timesteps
        if stage.ended_by is not None and saved >= stage.num_timesteps:
            result = {"num_timesteps": stage.num_timesteps, "ended_by": stage.ended_by}
            write_json(job.result_file, result)
        write_yaml(job.settings_file, job.settings)


@contextlib.contextmanager
def _owned(place: Path) -> Iterator[None]:
    """Keep other processes from training in a curriculum's folder; leave none that is empty."""
    busy = f"The curriculum in '{place}' is being trained"
    expected = (
        f"one process in a folder. Wait for its end or stop it; then go on with: {go_on(place)}"
    )
    try:
        with hold(place / LOCK_SUFFIX, busy, expected):
            yield
    finally:
        with contextlib.suppress(OSError):  # it is not empty, or is gone
            place.rmdir()


def go_on(place: Path) -> str:
    """Return the command that goes on with a curriculum in its folder."""
    return f"sb3-piano curriculum --resume {shlex.quote(str(place))}"
