"""Running of a curriculum: each stage is a run that starts from the one before."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shlex
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sb3_piano.callbacks import Checkpoint
from sb3_piano.callbacks.checkpoint import DEFAULT_EVERY
from sb3_piano.exceptions import RunError
from sb3_piano.files import Place, write_yaml
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs.folders import is_empty, unwritable
from sb3_piano.links import keep_inside
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.settings import Count, checked
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.runs.curriculum_checks import check_fit, check_unchanged
from sb3_piano.training.runs.curriculum_config import (
    CURRICULUM_FILE,
    Curriculum,
    load_curriculum,
)
from sb3_piano.training.runs.curriculum_progress import (
    Notes,
    StageEvaluation,
    StageProgress,
    StageWatch,
)
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.start import start_plugin
from sb3_piano.training.runs.train import TrainResult, resume, train


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
    ``<n>_<name>/``     the run of stage n, from 1 on, as :func:`~sb3_piano.training.train` makes it
    ``curriculum.yml``  the curriculum, each stage with all its settings, and the seed
    ``curriculum.json`` which stages have ended, after how many steps and why; all evaluations
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
    with _owned(place), stop_on_signal() as request:
        curriculum = _begin(place, curriculum)
        options = {"progress_bar": progress_bar, "checkpoint_every": checkpoint_every}
        work = _Work(place, curriculum, options)
        stages = range(len(curriculum.stages))
        todo = [index for index in stages if not work.has_ended(index)]
        for index in todo:
            if request.made:
                break
            on_stage(work.progress(index))
            if not work.finish(index):
                break
        progress = tuple(map(work.progress, stages))
    return CurriculumResult(folder=place, stages=progress, had_finished=not todo)


@dataclass(frozen=True)
class _Work:
    """Training of stages in a curriculum's folder."""

    path: Path
    curriculum: Curriculum
    options: dict[str, Any]
    """Arguments of :func:`train` and :func:`resume`."""

    notes_file = Place("curriculum.json")

    def progress(self, index: int) -> StageProgress:
        """Return what is noted of a stage."""
        return Notes.read(self.notes_file).of(self.curriculum.run_names[index])

    def has_ended(self, index: int) -> bool:
        """Return whether a stage has ended, and its last model is saved."""
        progress, run = self.progress(index), self._run(index)
        if progress.ended_by != "condition":
            return progress.ended_by is not None
        # Which is noted before the model is saved; a checkpoint may have been deleted since.
        saved = Checkpoint.read(run.checkpoint_dir)
        if saved is None:
            return run.model_file.is_file()
        return saved.num_timesteps >= progress.num_timesteps

    def finish(self, index: int) -> bool:
        """Bring a stage to its end; return whether it came there."""
        run = self._run(index)
        if run.has_begun:
            saved = Checkpoint.read(run.checkpoint_dir)
            known = () if saved is None else self.progress(index).evaluations
            done = 0 if saved is None else saved.num_timesteps
            kept = tuple(found for found in known if found.num_timesteps <= done)
            self._note(index, num_timesteps=done, ended_by=None, evaluations=kept)
            result = resume(run.path, callbacks=[self._watch(index)], **self.options)
        else:
            shutil.rmtree(run.path, ignore_errors=True)  # of a process that was killed early
            config = self._config(index)
            result = train(config, run.path, callbacks=[self._watch(index)], **self.options)
        return self._note_end(index, result)

    def _run(self, index: int) -> RunFolder:
        return RunFolder(self.path / self.curriculum.run_names[index])

    def _config(self, index: int) -> RunConfig:
        """Return the settings of a stage's new run, with its seed and its start."""
        stage = self.curriculum.stages[index]
        config = stage.run_config(self.curriculum.algo)
        config = dataclasses.replace(config, seed=self.curriculum.seed)
        start: str | os.PathLike[str] | None = self.curriculum.init_from
        if index > 0:
            before = self._run(index - 1)
            saved = Checkpoint.read(before.checkpoint_dir)
            if saved is not None:  # a process that was killed may not have copied its model
                saved.copy_model(before.checkpoint_dir, before.model_file)
            start = before.path
        if start is None:
            return config
        plugin = start_plugin(start, stage.with_buffer, stage.with_entropy)
        return dataclasses.replace(config, callback=(*config.callback, plugin))

    def _watch(self, index: int) -> StageWatch:
        def note(evaluations: tuple[StageEvaluation, ...], steps: int, met: bool) -> None:
            ended = "condition" if met else None
            self._note(index, num_timesteps=steps, ended_by=ended, evaluations=evaluations)

        until = self.curriculum.stages[index].until
        return StageWatch(until, self.progress(index).evaluations, note)

    def _note_end(self, index: int, result: TrainResult) -> bool:
        """Note how a training ended; return whether the stage has."""
        if self.progress(index).ended_by is not None:
            return True
        steps = result.num_timesteps
        ended = "budget" if steps >= result.n_timesteps else "callback"
        self._note(index, num_timesteps=steps, ended_by=None if result.interrupted else ended)
        return not result.interrupted

    def _note(self, index: int, **changes: Any) -> None:
        progress = dataclasses.replace(self.progress(index), **changes)
        Notes.read(self.notes_file).write(self.notes_file, progress)


def _begin(place: Path, curriculum: Curriculum) -> Curriculum:
    """Write a curriculum that fits into its folder; return it with a seed and absolute paths."""
    file, begun = place / CURRICULUM_FILE, 0
    # Those that are read from the file begin at its folder.
    curriculum = Curriculum.from_mapping(curriculum.to_mapping(), Path.cwd())
    if file.is_file():
        stored = load_curriculum(place)
        if curriculum.seed is None:
            curriculum = dataclasses.replace(curriculum, seed=stored.seed)
        begun = check_unchanged(place, stored, curriculum)
    elif not is_empty(place):
        raise RunError(
            f"Folder '{place}' is not empty, and holds no curriculum: expected a new or empty "
            "folder, or that of a curriculum."
        )
    if begun < len(curriculum.stages):
        check_fit(curriculum, place, begun)
    if curriculum.seed is None:
        drawn = int(np.random.default_rng().integers(2**31))
        curriculum = dataclasses.replace(curriculum, seed=drawn)
    try:
        write_yaml(file, curriculum.to_mapping())
    except OSError as error:
        raise unwritable(place, error) from error
    return curriculum


@contextlib.contextmanager
def _owned(place: Path) -> Iterator[None]:
    """Keep other processes from training in a curriculum's folder; leave none that is empty."""
    keep_inside(place)
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
