"""Import the user's music into the library."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import itertools
import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.files import check_file, read_file
from sb3_piano.music.fingering.apply import FINGERINGS, labels_file
from sb3_piano.music.formats import ACCEPTED_FILES, READERS, read_score
from sb3_piano.music.formats.pig import looks_like_pig
from sb3_piano.music.library.datasets import (
    PIG_PIECES,
    find_dataset,
    unpack_wheel,
)
from sb3_piano.music.library.piece_file import PieceInfo
from sb3_piano.music.library.store import (
    LONGEST_NAME,
    Library,
    check_name,
    cut,
    is_built_in,
    is_possible,
    slug,
)
from sb3_piano.music.library.task import ImportTask, Outcome, Unusable, run_tasks
from sb3_piano.music.text_file import is_hidden
from sb3_piano.settings import Count, checked
from sb3_piano.threads import usable_cores
from sb3_piano.unfinished import scratch_folder

_WHEEL = ".whl"

_HEAD = 4096
"""Bytes at the start of a file that are enough to recognise its format."""


@dataclass(frozen=True, kw_only=True)
class ImportReport:
    """Result of an import.

    Attributes:
        imported: Names of the new pieces.
        present: Names of the pieces that the library already had, from the same file with the same
            fingering.
        copies: Number of files left out because another one has the same content.
        unusable: Files that could not be imported, and why.
        notes: Files that were imported in spite of some defect, and the defect.
        interrupted: Whether Ctrl-C ended the import. Imported pieces stay, and another import of
            the same path continues with the others.
    """

    imported: tuple[str, ...]
    present: tuple[str, ...]
    copies: int
    unusable: tuple[Unusable, ...]
    notes: tuple[Unusable, ...]
    interrupted: bool


def import_path(
    path: str | os.PathLike[str],
    library: Library | None = None,
    *,
    fingering: str | os.PathLike[str] | None = None,
    name: str | None = None,
    parts: Sequence[str | int] = (),
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ImportReport:
    """Import a file, a folder of files, the PIG data set or RoboPianist's snippets.

    Pieces already in the library, from the same content and with the same fingering, stay
    unchanged, so a repeated import continues an interrupted one. With several processes, a calling
    script needs ``if __name__ == "__main__":``.

    Args:
        path: A file of a supported format; a folder, searched recursively, whose MAESTRO table
            gives the titles if it has one; the folder of the PIG data set; a wheel, a checkout or
            an installation of robopianist.
        library: The library to import into; by default the user's own.
        fingering: As in :func:`~sb3_piano.music.fingering.apply.apply_fingering`. By default
            ``"keep"`` for the PIG data set, which is labelled, else ``"ergonomic"``.
        name: The piece's name, if the path is a single file; by default the file's own.
        parts: Parts to read from a single MusicXML file, by name or number.
        jobs: Number of processes that read; by default one for each usable core.
        progress: Called after each piece with the number of finished pieces and the total.

    Raises:
        ScoreError: If there is nothing to import. Unreadable files, single ones or in a folder, are
            listed in the report instead.
        ConfigError: If a setting is not valid, or another import is under way.
    """
    library = Library() if library is None else library
    jobs = usable_cores() if jobs is None else checked("jobs", jobs, Count)
    imported: list[str] = []
    notes: list[Unusable] = []
    with _search(Path(path)) as (found, unusable), library.importing():
        if len(found) != 1:
            _check_single(name, fingering, parts)
        elif name is not None:
            check_name(name)
            found = [replace(found[0], names=((name, "imported"),))]
        if parts:
            found = [replace(found[0], read=partial(read_score, parts=tuple(parts)))]
        plan = _ImportPlan(library, None if fingering is None else os.fspath(fingering), parts)
        for piece in found:
            try:
                plan.add(piece)
            except OSError as error:
                unusable.append(Unusable(piece.path, f"It cannot be read: {error.strerror}."))
        done = itertools.count(1)

        def tell(task: ImportTask, outcome: Outcome) -> None:
            notes.extend(Unusable(task.path, note) for note in outcome.notes)
            if outcome.error is None:
                imported.extend(piece_name for piece_name, _ in task.names)
            else:
                unusable.append(Unusable(task.path, outcome.error))
            if progress is not None:
                progress(next(done), len(plan.tasks))

        interrupted = run_tasks(plan.tasks, library.folder, jobs, tell)
    return ImportReport(
        imported=tuple(sorted(imported)),
        present=tuple(sorted(set(plan.present))),
        copies=plan.copies,
        unusable=tuple(unusable),
        notes=tuple(notes),
        interrupted=interrupted,
    )


@contextlib.contextmanager
def _search(path: Path) -> Iterator[tuple[list[ImportTask], list[Unusable]]]:
    """Find the pieces at a path; a wheel is unpacked for the duration of the context.

    A folder is searched recursively, except hidden folders. Text and XML files count as music if
    their content looks like it, as folders also have readmes.

    Raises:
        ScoreError: If there is no such path, or nothing that can be imported.
    """
    if not os.path.exists(path):  # which also answers for a name that no file can have
        raise ScoreError(f"There is no '{path}': expected {ACCEPTED_FILES}, or a folder.")
    if path.suffix == _WHEEL:
        with scratch_folder() as folder:
            yield unpack_wheel(path, folder), []
    elif path.is_dir():
        yield _search_folder(path)
    elif path.suffix.lower() in READERS:
        yield [ImportTask(path=path, source=path.name)], []
    else:
        raise ScoreError(
            f"Cannot tell the format of '{path}': expected {ACCEPTED_FILES}, a folder, or a wheel "
            "of robopianist."
        )


def _search_folder(folder: Path) -> tuple[list[ImportTask], list[Unusable]]:
    known, home = find_dataset(folder) or ([], None)
    if home is not None and home.parent != folder:
        return known, []
    unusable = []
    titles: dict[Path, str] = {}
    try:
        titles = _read_titles(folder)
    except ScoreError as error:
        unusable.append(Unusable(folder, str(error)))
    found = [
        ImportTask(path=path, title=titles.get(path), source=str(path.relative_to(folder)))
        for path in _music_files(folder)
        if home is None or not path.is_relative_to(home)
    ]
    found = [*known, *found]
    if not found:
        raise ScoreError(f"'{folder}' has no music in it: expected {ACCEPTED_FILES}.")
    return found, unusable


def _music_files(folder: Path) -> Iterator[Path]:
    for place, folders, files in os.walk(folder):
        # In place, so that walk() does not enter the others.
        folders[:] = sorted(name for name in folders if not is_hidden(name))
        for name in sorted(files):
            path = Path(place, name)
            if not is_hidden(name) and path.suffix.lower() in READERS and _may_be(path):
                yield path


def _may_be(path: Path) -> bool:
    """Return whether a file with an ambiguous suffix looks like music."""
    suffix = path.suffix.lower()
    if suffix not in (".txt", ".xml"):
        return True
    try:
        check_file(path)
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    if suffix == ".xml":
        head = head.replace(b"\0", b"")  # UTF-16 has them
        return b"score-partwise" in head or b"score-timewise" in head
    return looks_like_pig(head)


def _read_titles(folder: Path) -> dict[Path, str]:
    """Read the titles of files from MAESTRO's table, if the folder has it."""
    tables = sorted(path for path in folder.glob("maestro-v*.csv") if path.is_file())
    if not tables:
        return {}
    table = tables[-1]
    try:
        text = read_file(table).decode("utf-8-sig")
        return {
            folder / row["midi_filename"]: f"{row['canonical_composer']}: {row['canonical_title']}"
            for row in csv.DictReader(io.StringIO(text))
            if row["midi_filename"] is not None  # as in the last row of a table that is cut short
        }
    except (OSError, ValueError, KeyError, csv.Error) as error:
        raise ScoreError(
            f"Cannot read '{table}' ({type(error).__name__}: {error}): expected MAESTRO's table "
            "with canonical_composer, canonical_title and midi_filename."
        ) from error


class _ImportPlan:
    """The ``tasks`` to do, names of pieces already ``present``, and the number of ``copies``."""

    def __init__(
        self, library: Library, fingering: str | None, parts: Sequence[str | int] = ()
    ) -> None:
        """Read the library's present content.

        Raises:
            ConfigError: If there is no such fingering.
        """
        self.tasks: list[ImportTask] = []
        self.present: list[str] = []
        self.copies = 0
        self._fingering = fingering
        self._setting = None if fingering is None else _setting(fingering)
        self._parts = f" of {', '.join(map(str, parts))}" if parts else ""
        self._infos = library.infos()
        # Damaged pieces keep their names: they are not overwritten unasked.
        self._taken = set(library.names())
        self._by_content = {(i.sha256, i.setting): i.name for i in self._infos.values()}
        # Replaceable pieces, by the content of their file and by its path.
        self._replaceable: dict[str, list[PieceInfo]] = defaultdict(list)
        for info in self._infos.values():
            if info.collection == "imported":
                for key in filter(None, (info.path, info.sha256)):
                    self._replaceable[key].append(info)
        self._kept: set[str] = set()
        self._planned: set[tuple[str, str]] = set()
        self._new: set[str] = set()

    def add(self, task: ImportTask) -> None:
        """Plan the import of a piece, unless the library already has it.

        Raises:
            OSError: If its file cannot be read.
        """
        sha256 = hashlib.sha256(read_file(task.path)).hexdigest()
        setting = (task.fingering if self._setting is None else self._setting) + self._parts
        content = (sha256, setting)
        if task.names:
            infos = [self._infos.get(name) for name, _ in task.names]
            for info in filter(None, infos):
                if info.collection == "imported" and str(task.path.absolute()) != info.path:
                    self._check_same(info, sha256)
            there = [i.name for i in infos if i and (i.sha256, i.setting) == content]
            self.present += there
            names = tuple(pair for pair in task.names if pair[0] not in there)
        else:
            name = self._chosen_name(task.path, content)
            names = () if name is None else ((name, "imported"),)
        if names:
            fingering = task.fingering if self._fingering is None else self._fingering
            self.tasks.append(
                replace(task, names=names, fingering=fingering, setting=setting, sha256=sha256)
            )

    def _check_same(self, info: PieceInfo, sha256: str) -> None:
        if info.sha256 != sha256:
            raise ConfigError(
                f"There is another piece {info.name!r}, of '{info.path}': expected a name that is "
                f"free, or to take that one away before: sb3-piano pieces remove {info.name}"
            )

    def _chosen_name(self, path: Path, content: tuple[str, str]) -> str | None:
        """Choose a name for a piece, or None if the library already has its content.

        The piece replaces one with the same content but another fingering, or one of the same file
        before a change.
        """
        known = self._by_content.get(content)
        if content in self._planned or known in self._kept:
            self.copies += 1
            return None
        if known is not None and known not in self._new:
            self.present.append(known)
            self._kept.add(known)
            return None
        keys = (content[0], str(path.absolute()))
        replaced = (self._replaced(key, path, content[1]) for key in keys)
        name = next(filter(None, replaced), None) or self._free_name(path)
        self._planned.add(content)
        self._new.add(name)
        return name

    def _replaced(self, key: str, path: Path, setting: str) -> str | None:
        """Return the name of the piece to replace, by a content or file, or None.

        Other parts of a file are another piece. Among several candidates, it is the one with the
        same fingering, or the one named like the file.
        """
        found = [
            info
            for info in self._replaceable.get(key, ())
            # Older versions allowed names that are invalid now.
            if is_possible(info.name) and not is_built_in(info.name)
            if info.name not in self._new | self._kept
            if info.setting.partition(" of ")[2] == setting.partition(" of ")[2]
        ]
        alike = [info for info in found if info.setting == setting]
        named = [info for info in found if info.name == slug(path.stem)]
        several = alike or named or (found if len(found) == 1 else [])
        return several[0].name if several else None

    def _free_name(self, path: Path) -> str:
        """Return a free name for the piece in a file, similar to the file's own.

        If that is taken, the folder's name is added before it, then a number after it.
        """
        longer = slug(f"{path.absolute().parent.name} {path.stem}")
        numbered = (f"{cut(longer, LONGEST_NAME - 8)}-{number}" for number in itertools.count(2))
        names = itertools.chain([slug(path.stem), longer], numbered)
        return next(
            name
            for name in names
            if not (
                name in self._taken or name in self._new or is_built_in(name) or name in PIG_PIECES
            )
        )


def _setting(fingering: str) -> str:
    """Return the text that identifies a fingering: for a labels file, its checksum.

    Raises:
        ConfigError: If there is no such fingering.
    """
    if fingering in FINGERINGS:
        return fingering
    labels = labels_file(fingering)
    try:
        return f"labels {hashlib.sha256(read_file(labels)).hexdigest()}"
    except OSError as error:
        raise ConfigError(f"Cannot read the labels in '{labels}': {error.strerror}.") from error


def _check_single(
    name: str | None, fingering: str | os.PathLike[str] | None, parts: Sequence[str | int]
) -> None:
    if parts:
        raise ConfigError("Parts can be chosen of one piece only: expected a single MusicXML file.")
    if name is not None:
        raise ConfigError(
            f"Name {name!r} cannot be given to more than one piece: expected a single file."
        )
    if fingering is not None and fingering not in FINGERINGS:
        raise ConfigError(
            f"Fingering '{os.fspath(fingering)}' cannot be used for more than one piece: expected "
            f"{', '.join(map(repr, FINGERINGS))}."
        )
