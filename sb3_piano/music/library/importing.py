"""Bring the user's music into the library."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.fingering.apply import FINGERINGS, labels_file
from sb3_piano.music.library.datasets import PIG_PIECES, Found, Unusable
from sb3_piano.music.library.search import search
from sb3_piano.music.library.store import (
    LONGEST_NAME,
    Library,
    check_name,
    is_built_in,
    slug,
    user_library,
)
from sb3_piano.music.library.task import ImportTask, Outcome, run_tasks
from sb3_piano.settings import Count, checked
from sb3_piano.threads import usable_cores


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
    progress: Callable[[int, int], None] | None = None,
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
        progress: Called after each piece with how many are done, and of how many.

    Raises:
        ScoreError: If there is nothing to import. A file of a folder that cannot be read is
            listed in the report instead, and so is a single one.
        ConfigError: If a setting is not valid, or another import is under way.
    """
    library = user_library() if library is None else library
    jobs = usable_cores() if jobs is None else checked("jobs", jobs, Count)
    imported: list[str] = []
    notes: list[Unusable] = []
    with search(Path(path)) as (found, unusable), library.importing():
        if len(found) != 1:
            _check_single(name, fingering)
        plan = _ImportPlan(library, None if fingering is None else os.fspath(fingering))
        for piece in found:
            try:
                plan.add(piece, name)
            except OSError as error:
                unusable.append(Unusable(piece.path, f"It cannot be read: {error}."))
        n_told = 0

        def tell(task: ImportTask, outcome: Outcome) -> None:
            nonlocal n_told
            notes.extend(Unusable(task.found.path, note) for note in outcome.notes)
            if outcome.error is None:
                imported.extend(piece_name for piece_name, _ in task.names)
            else:
                unusable.append(Unusable(task.found.path, outcome.error))
            n_told += 1
            if progress is not None:
                progress(n_told, len(plan.tasks))

        interrupted = run_tasks(plan.tasks, jobs, tell)
    return ImportReport(
        imported=tuple(sorted(imported)),
        present=tuple(sorted(set(plan.present))),
        unusable=tuple(unusable),
        notes=tuple(notes),
        interrupted=interrupted,
    )


class _ImportPlan:
    """The tasks of an import, each with the names of its piece, and what is there already."""

    def __init__(self, library: Library, fingering: str | None) -> None:
        """Look at what the library has.

        Raises:
            ConfigError: If there is no such fingering.
        """
        self.tasks: list[ImportTask] = []
        self.present: list[str] = []
        self._folder = library.folder
        self._infos = library.infos()
        self._known = {(i.sha256, i.setting): name for name, i in self._infos.items()}
        replaceable = [i for i in self._infos.values() if i.collection == "imported"]
        self._by_content = {info.sha256: info.name for info in replaceable if info.sha256}
        self._by_path = {info.path: info.name for info in replaceable if info.path}
        # Damaged pieces hold their names, too: nothing is written over them unasked.
        self._taken = set(library.names())
        self._planned: set[str] = set()
        self._fingering = fingering
        self._setting = None if fingering is None else _setting(fingering)

    def add(self, found: Found, name: str | None) -> None:
        """Plan the import of a piece, unless it is there already.

        Args:
            found: The piece.
            name: The name that it must have, if any.

        Raises:
            ConfigError: If it cannot have that name.
            OSError: If its file cannot be read.
        """
        sha256 = hashlib.sha256(found.path.read_bytes()).hexdigest()
        content = (sha256, found.fingering if self._setting is None else self._setting)
        if name is not None:
            check_name(name)
            names = self._missing(((name, "imported"),), content)
        elif found.names:
            names = self._missing(found.names, content)
        else:
            names = self._chosen(found.path, content)
        if names:
            self.tasks.append(
                ImportTask(
                    found=found,
                    names=names,
                    folder=self._folder,
                    fingering=found.fingering if self._fingering is None else self._fingering,
                    setting=content[1],
                    sha256=sha256,
                )
            )

    def _missing(
        self, names: Sequence[tuple[str, str]], content: tuple[str, str]
    ) -> tuple[tuple[str, str], ...]:
        """Return those of given names, with collections, under which there is other content."""
        infos = [self._infos.get(name) for name, _ in names]
        there = [info.name for info in infos if info and (info.sha256, info.setting) == content]
        self.present += there
        return tuple(pair for pair in names if pair[0] not in there)

    def _chosen(self, path: Path, content: tuple[str, str]) -> tuple[tuple[str, str], ...]:
        """Return a name for a piece, unless its content is there already.

        It replaces what has the same content with another fingering, or is of the same file before
        it was changed.
        """
        if content in self._known:
            known = self._known[content]
            if known not in self._planned:  # else this file is a copy of one that is imported
                self.present.append(known)
            return ()
        before = (self._by_content.get(content[0]), self._by_path.get(str(path.absolute())))
        replaced = [name for name in before if name is not None and name not in self._planned]
        name = replaced[0] if replaced else free_name(path, self._is_free)
        self._known[content] = name
        self._taken.add(name)
        self._planned.add(name)
        return ((name, "imported"),)

    def _is_free(self, name: str) -> bool:
        return not (name in self._taken or is_built_in(name) or name in PIG_PIECES)


def free_name(path: Path, is_free: Callable[[str], bool]) -> str:
    """Return a name for the piece in a file that is free, near to the file's own.

    Args:
        path: The file; if its own name is taken, the folder's name is put in front, then a number
            behind.
        is_free: Tells whether a name may be used.
    """
    plain = slug(path.stem)
    longer = slug(f"{path.absolute().parent.name} {path.stem}")
    for name in (plain, longer):
        if is_free(name):
            return name
    number = 2
    while not is_free(name := f"{longer[: LONGEST_NAME - 8]}-{number}"):
        number += 1
    return name


def _setting(fingering: str) -> str:
    """Return what is noted of a fingering: of a file with labels, its content.

    Raises:
        ConfigError: If there is no such fingering.
    """
    if fingering in FINGERINGS:
        return fingering
    labels = labels_file(fingering)
    try:
        return f"labels {hashlib.sha256(labels.read_bytes()).hexdigest()}"
    except OSError as error:
        raise ConfigError(f"Cannot read the labels in '{labels}': {error}.") from error


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
