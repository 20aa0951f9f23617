"""Imports to do of the pieces that were found, and their names."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.fingering.apply import FINGERINGS, labels_file
from sb3_piano.music.library.found import Found
from sb3_piano.music.library.naming import check_name, free_name
from sb3_piano.music.library.pig_pieces import PIG_PIECES
from sb3_piano.music.library.reserved import is_built_in
from sb3_piano.music.library.search import Unusable
from sb3_piano.music.library.store import Library
from sb3_piano.music.library.task import Task


class ImportPlan:
    """The import of some pieces into a library.

    Attributes:
        tasks: What there is to do, in the order in which the pieces were found.
        present: The names of pieces that are there already.
        unusable: The files that cannot be read at all.
    """

    def __init__(self, library: Library, fingering: str | os.PathLike[str] | None) -> None:
        """Look at what the library has.

        Args:
            library: Where the pieces will go.
            fingering: As in `apply_fingering`, or None for what is usual with each piece.

        Raises:
            ConfigError: If there is no such fingering.
        """
        self.tasks: list[Task] = []
        self.present: list[str] = []
        self.unusable: list[Unusable] = []
        self._folder = library.folder
        self._infos = library.infos()
        self._known = {(i.sha256, i.setting): name for name, i in self._infos.items()}
        replaceable = [i for i in self._infos.values() if i.collection == "imported"]
        self._by_content = {info.sha256: info.name for info in replaceable if info.sha256}
        self._by_path = {info.path: info.name for info in replaceable if info.path}
        # Damaged pieces hold their names, too: nothing is written over them unasked.
        self._taken = set(library.names())
        self._planned: set[str] = set()
        self._fingering = None if fingering is None else os.fspath(fingering)
        self._setting = None if self._fingering is None else _setting(self._fingering)

    def add(self, found: Found, name: str | None = None) -> None:
        """Plan the import of a piece, unless it is there already.

        Args:
            found: The piece.
            name: The name that it must have, if any.

        Raises:
            ConfigError: If it cannot have that name.
        """
        try:
            sha256 = found.sha256()
        except OSError as error:
            self.unusable.append(Unusable(found.path, f"It cannot be read: {error}."))
            return
        fingering = found.fingering if self._fingering is None else self._fingering
        setting = found.fingering if self._setting is None else self._setting
        names = self._names(found, sha256, setting, name)
        if names:
            self.tasks.append(
                Task(
                    found=found,
                    names=names,
                    folder=self._folder,
                    fingering=fingering,
                    setting=setting,
                    sha256=sha256,
                )
            )

    def _names(
        self, found: Found, sha256: str, setting: str, name: str | None
    ) -> tuple[tuple[str, str], ...]:
        """Return the names, with collections, under which a piece is missing."""
        if found.names or name is not None:
            if name is not None:
                check_name(name, is_built_in)
            wanted = found.names if name is None else ((name, "imported"),)
            there = [pair for pair in wanted if self._is_same(pair[0], sha256, setting)]
            self.present += [there_name for there_name, _ in there]
            return tuple(pair for pair in wanted if pair not in there)
        if (sha256, setting) in self._known:
            known = self._known[sha256, setting]
            if known not in self._planned:  # else this file is a copy of one that is imported
                self.present.append(known)
            return ()
        chosen = self._replaced(found.path, sha256) or free_name(found.path, self._is_free)
        self._known[sha256, setting] = chosen
        self._taken.add(chosen)
        self._planned.add(chosen)
        return ((chosen, "imported"),)

    def _is_same(self, name: str, sha256: str, setting: str) -> bool:
        info = self._infos.get(name)
        return info is not None and (info.sha256, info.setting) == (sha256, setting)

    def _is_free(self, name: str) -> bool:
        return not (name in self._taken or is_built_in(name) or name in PIG_PIECES)

    def _replaced(self, path: Path, sha256: str) -> str | None:
        """Return the name of the piece that the import of this file is to replace, if any.

        That is one of the same content with another fingering, or of the same file before it was
        changed.
        """
        for name in (self._by_content.get(sha256), self._by_path.get(str(path.absolute()))):
            if name is not None and name not in self._planned:
                return name
        return None


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
