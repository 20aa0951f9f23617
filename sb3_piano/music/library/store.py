"""A folder of imported pieces."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import (
    ConfigError,
    RunError,
    ScoreError,
    UnknownPieceError,
    near_names,
)
from sb3_piano.files import PARTIAL_SUFFIX
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.music.library.folder import DATA_VARIABLE, pieces_folder
from sb3_piano.music.library.naming import check_name
from sb3_piano.music.library.piece_file import (
    SUFFIX,
    PieceInfo,
    read_info,
    read_piece,
    write_piece,
)
from sb3_piano.music.library.reserved import is_built_in
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score

_CLOCK_TICK = 100_000_000
"""A folder's time of change does not tell changes apart that are nearer than this, in ns."""


_Signature = tuple[int, int]
"""Signature of a file, another one when it is replaced: time of change, in ns, and size."""


class Library:
    """Pieces of the user's, one file each, in a folder.

    A file that is damaged, or of a newer version, spoils nothing but itself: its piece is listed,
    and making its score raises an error that names the file.
    """

    def __init__(self, folder: str | os.PathLike[str] | None = None) -> None:
        """Look at a folder, which need not exist yet.

        Args:
            folder: Where the files are; by default ``pieces`` in the folder for the user's data,
                which the environment variable ``SB3_PIANO_DATA`` may name.
        """
        self.folder = pieces_folder() if folder is None else Path(folder)
        self._known: dict[str, tuple[_Signature, PieceInfo | ScoreError]] = {}
        self._listed: tuple[int, dict[str, _Signature]] | None = None

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._signatures()

    def __len__(self) -> int:
        return len(self._signatures())

    def add(
        self,
        score: Score,
        name: str,
        *,
        source: str,
        fingering: str,
        collection: str = "imported",
        **more: Any,
    ) -> None:
        """Keep a score under a name, in place of what had that name.

        Args:
            score: The score. The one that the library gives back has the name as its title.
            name: Letters, digits, hyphens and underscores.
            source: Where the notes come from, in one line.
            fingering: Who chose the fingers, in a word or two.
            collection: What the piece belongs to.
            **more: Further fields of `PieceInfo`: ``title``, by default the name; ``path``,
                ``sha256``, ``setting``, ``features``.

        Raises:
            ConfigError: If a piece cannot have that name.
        """
        check_name(name, is_built_in)
        info = PieceInfo(
            name=name,
            collection=collection,
            source=source,
            fingering=fingering,
            n_notes=len(score.notes),
            duration=score.duration,
            **{"title": name, **more},
        )
        self.folder.mkdir(parents=True, exist_ok=True)
        write_piece(self.path(name), score, info)
        self._listed = None

    def remove(self, name: str) -> None:
        """Remove a piece, damaged or not.

        Raises:
            UnknownPieceError: If the library has no such piece.
        """
        self._check_known(name)
        self.path(name).unlink(missing_ok=True)
        self._listed = None

    def pieces(self) -> Mapping[str, Piece]:
        """Return all pieces by name, in alphabetical order; each score is made when asked for."""
        return _Pieces(self, self._signatures())

    def names(self) -> tuple[str, ...]:
        """Return the names of all pieces, damaged or not, in alphabetical order."""
        return tuple(self._signatures())

    def info(self, name: str) -> PieceInfo:
        """Return what is known about a piece.

        Raises:
            UnknownPieceError: If the library has no such piece.
            ScoreError: If its file is damaged or of a newer version.
        """
        found = self._look_up(name, self._check_known(name))
        if isinstance(found, ScoreError):
            raise found
        return found

    def infos(self) -> dict[str, PieceInfo]:
        """Return what is known about each piece whose file is sound, by name."""
        found = {name: self._look_up(name, s) for name, s in self._signatures().items()}
        return {name: info for name, info in found.items() if isinstance(info, PieceInfo)}

    def damaged(self) -> dict[str, ScoreError]:
        """Return what is wrong with the pieces that cannot be read, by name."""
        found = {name: self._look_up(name, s) for name, s in self._signatures().items()}
        return {name: error for name, error in found.items() if isinstance(error, ScoreError)}

    def score(self, name: str) -> Score:
        """Return a piece's score.

        Raises:
            UnknownPieceError: If the library has no such piece.
            ScoreError: If its file is damaged or of a newer version.
        """
        self._check_known(name)
        return read_piece(self.path(name))

    def path(self, name: str) -> Path:
        """Return the file of a piece, whether there is one or not."""
        return self.folder / f"{name}{SUFFIX}"

    @contextlib.contextmanager
    def importing(self) -> Iterator[None]:
        """Keep other imports out, and remove what one that was killed has left.

        Raises:
            ConfigError: If another import into this library is under way, or its folder cannot be
                written to.
        """

        def busy(owner: str) -> ConfigError:
            return ConfigError(
                f"Another import into '{self.folder}' is under way, by {owner}: expected one at a "
                "time."
            )

        with contextlib.ExitStack() as stack:
            try:
                stack.enter_context(hold(self.folder / LOCK_SUFFIX, busy))
            except RunError as error:
                raise ConfigError(
                    f"Cannot keep pieces in '{self.folder}': {error} The environment variable "
                    f"{DATA_VARIABLE} may name another."
                ) from error
            for partial_file in self.folder.glob(f"*{PARTIAL_SUFFIX}"):
                partial_file.unlink(missing_ok=True)
            yield

    def _check_known(self, name: str) -> _Signature:
        known = self._signatures()
        if name not in known:
            raise UnknownPieceError(
                f"The library in '{self.folder}' has no piece {name!r}."
                f"{near_names(name, known)} Expected a name from 'sb3-piano pieces list'."
            )
        return known[name]

    def _signatures(self) -> dict[str, _Signature]:
        """Return for each piece what changes when its file does."""
        try:
            changed = os.stat(self.folder).st_mtime_ns
        except FileNotFoundError:
            return {}
        if self._listed is not None and self._listed[0] == changed:
            return self._listed[1]
        now = time.time_ns()
        stats = {
            entry.name.removesuffix(SUFFIX): entry.stat()
            for entry in os.scandir(self.folder)
            if entry.name.endswith(SUFFIX)
        }
        signatures = {
            name: (stats[name].st_mtime_ns, stats[name].st_size) for name in sorted(stats)
        }
        # Another change within the same tick of the clock could not be seen afterwards.
        self._listed = (changed, signatures) if now - changed > _CLOCK_TICK else None
        return signatures

    def _look_up(self, name: str, signature: _Signature) -> PieceInfo | ScoreError:
        known = self._known.get(name)
        if known is None or known[0] != signature:
            try:
                found: PieceInfo | ScoreError = read_info(self.path(name))
            except ScoreError as error:
                found = error
            known = self._known[name] = (signature, found)
        return known[1]

    def _piece(self, name: str, signature: _Signature) -> Piece:
        found = self._look_up(name, signature)
        if isinstance(found, ScoreError):
            found = PieceInfo(
                name=name,
                title=name,
                collection="imported",
                source=str(found),
                fingering="none",
            )
        return Piece(
            name=name,
            title=found.title,
            collection=found.collection,
            source=found.source,
            fingering=found.fingering,
            build=partial(read_piece, self.path(name)),
        )


class _Pieces(Mapping[str, Piece]):
    """The pieces of a library; a file is not read before its piece is asked for."""

    def __init__(self, library: Library, signatures: Mapping[str, _Signature]) -> None:
        self._library = library
        self._signatures = signatures

    def __getitem__(self, name: str) -> Piece:
        return self._library._piece(name, self._signatures[name])

    def __contains__(self, name: object) -> bool:
        return name in self._signatures

    def __iter__(self) -> Iterator[str]:
        return iter(self._signatures)

    def __len__(self) -> int:
        return len(self._signatures)
