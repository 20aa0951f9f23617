"""Bring the user's music into the library."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Integral
from pathlib import Path

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.fingering.apply import FINGERINGS
from sb3_piano.music.library.imported import user_library
from sb3_piano.music.library.plan import ImportPlan
from sb3_piano.music.library.search import Unusable, search
from sb3_piano.music.library.store import Library
from sb3_piano.music.library.task import Outcome, Task
from sb3_piano.music.library.workers import run_tasks
from sb3_piano.threads import usable_cores

Progress = Callable[[int, int], None]
"""Is told how many pieces are done, and of how many."""


@dataclass(frozen=True, kw_only=True)
class ImportReport:
    """Result of an import.

    Attributes:
        imported: The names of the pieces that are new in the library.
        present: The names of the pieces that were there before, from the same file and with the
            same fingering.
        unusable: The files that could not be imported, and why.
        notes: The files that were imported although something in them is odd, and what.
        interrupted: Whether Ctrl-C ended it; the pieces above are in the library all the same,
            and another import of the same path goes on with the others.
    """

    imported: tuple[str, ...]
    present: tuple[str, ...]
    unusable: tuple[Unusable, ...]
    notes: tuple[Unusable, ...]
    interrupted: bool


def import_path(
    path: str | os.PathLike[str],
    library: Library | None = None,
    *,
    fingering: str | os.PathLike[str] | None = None,
    name: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> ImportReport:
    """Import a file, a folder of files, the PIG data set or RoboPianist's snippets.

    Whatever is in the library already, from the same content and with the same fingering, is left
    as it is, so that an import that was interrupted goes on where it was. With several processes
    a script that calls this needs ``if __name__ == "__main__":``.

    Args:
        path: A file of a format that can be read; a folder, searched with all in it, whose
            MAESTRO table gives the titles if there is one; the folder of the PIG data set; a
            wheel, a checkout or an installation of robopianist.
        library: Where to; by default the user's own library.
        fingering: As in :func:`~sb3_piano.music.fingering.apply.apply_fingering`. By default
            ``"keep"`` for the PIG data set, which is labelled, else ``"ergonomic"``.
        name: The piece's name, if the path is a single file; by default the file's own.
        jobs: How many processes read; by default one for each usable core.
        progress: Called after each piece.

    Raises:
        ScoreError: If there is nothing to import. A file of a folder that cannot be read is
            listed in the report instead, and so is a single one.
        ConfigError: If a setting is not valid, or another import is under way.
    """
    library = user_library() if library is None else library
    jobs = usable_cores() if jobs is None else _checked(jobs)
    with search(Path(path)) as (found, unusable), library.importing():
        if len(found) != 1:
            _check_single(name, fingering)
        plan = ImportPlan(library, fingering)
        for piece in found:
            plan.add(piece, name)
        run = _Run(plan, list(unusable), progress)
        try:
            run_tasks(plan.tasks, jobs, run.tell)
        except KeyboardInterrupt:
            run.interrupted = True
        return run.report()


@dataclass
class _Run:
    """Import under way, with its results so far."""

    plan: ImportPlan
    unusable: list[Unusable]
    progress: Progress | None
    imported: list[str] = field(default_factory=list)
    notes: list[Unusable] = field(default_factory=list)
    n_done: int = 0
    interrupted: bool = False

    def tell(self, task: Task, outcome: Outcome) -> None:
        path = task.found.path
        self.notes += [Unusable(path, note) for note in outcome.notes]
        if outcome.error is None:
            self.imported += [name for name, _ in task.names]
        else:
            self.unusable.append(Unusable(path, outcome.error))
        self.n_done += 1
        if self.progress is not None:
            self.progress(self.n_done, len(self.plan.tasks))

    def report(self) -> ImportReport:
        return ImportReport(
            imported=tuple(sorted(self.imported)),
            present=tuple(sorted(set(self.plan.present))),
            unusable=(*self.unusable, *self.plan.unusable),
            notes=tuple(self.notes),
            interrupted=self.interrupted,
        )


def _check_single(name: str | None, fingering: str | os.PathLike[str] | None) -> None:
    if name is not None:
        raise ConfigError(
            f"Name {name!r} cannot be given to more than one piece: expected a single file."
        )
    if fingering is not None and fingering not in FINGERINGS:
        raise ConfigError(
            f"Fingering '{os.fspath(fingering)}' cannot be used for more than one piece: expected "
            f"{', '.join(map(repr, FINGERINGS))}."
        )


def _checked(jobs: int) -> int:
    if isinstance(jobs, bool) or not isinstance(jobs, Integral) or jobs < 1:
        raise ConfigError(f"jobs is {jobs!r}: expected a whole number from 1 on.")
    return int(jobs)
