"""A library of imported pieces in a folder."""

from __future__ import annotations

import contextlib
import os
import re
import unicodedata
from collections.abc import Iterator
from dataclasses import fields
from functools import cache, partial
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import (
    ConfigError,
    RunError,
    ScoreError,
    UnknownPieceError,
    near_names,
)
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.music.built_in import BUILT_IN
from sb3_piano.music.difficulty import Features, features
from sb3_piano.music.library.piece_file import (
    PieceInfo,
    read_info,
    read_piece,
    write_piece,
)
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.unfinished import PARTIAL_SUFFIX
from sb3_piano.user_data import DATA_VARIABLE, PIECE_SUFFIX, piece_names, pieces_folder

LONGEST_NAME = 200
"""Longest name, in bytes of UTF-8: file systems allow 255, including the suffix."""

_NAME = re.compile(r"\w[\w-]*")


def slug(text: str) -> str:
    """Convert text to a name: ``"Für Elise (1810).2"`` to ``"Fur-Elise-1810-2"``.

    Letters lose their accents; other characters, except digits and underscores, become hyphens.
    """
    decomposed = unicodedata.normalize("NFKD", text)
    letters = "".join(mark for mark in decomposed if not unicodedata.combining(mark))
    words = re.sub(r"[\W]+", "-", unicodedata.normalize("NFC", letters))
    return cut(words, LONGEST_NAME).strip("-_") or "piece"


def cut(text: str, size: int) -> str:
    """Cut text to a number of bytes of UTF-8."""
    return text.encode(errors="replace")[:size].decode(errors="ignore")


def is_built_in(name: str) -> bool:
    """Return whether a built-in piece has this name, in full or in short."""
    return any(piece.name in (name, f"{piece.collection}-{name}") for piece in BUILT_IN.values())


def is_possible(name: str) -> bool:
    """Return whether a name is valid for a piece."""
    return _NAME.fullmatch(name) is not None and len(name.encode()) <= LONGEST_NAME


def check_name(name: str) -> None:
    """Refuse a name that is invalid for an imported piece.

    Raises:
        ConfigError: If it has characters that an id cannot have, is too long, or belongs to a
            built-in piece.
    """
    if not is_possible(name):
        raise ConfigError(
            f"A piece cannot be named {name!r}: expected letters, digits, hyphens and "
            f"underscores, at most {LONGEST_NAME} bytes, such as {slug(name)!r}."
        )
    if is_built_in(name):
        raise ConfigError(
            f"A piece cannot be named {name!r}: a piece that comes with the package is. Expected "
            "another name."
        )


class Library:
    """A folder of the user's pieces, one file each.

    A damaged file, or one of a newer version, affects only its own piece: the piece is listed, and
    making its score raises an error that names the file.
    """

    def __init__(self, folder: str | os.PathLike[str] | None = None) -> None:
        """Open a folder, which need not exist yet; by default the one for the user's pieces."""
        self.folder = pieces_folder() if folder is None else Path(folder)

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def names(self) -> tuple[str, ...]:
        """List the names of all pieces, damaged or not, in alphabetical order.

        The list is empty if the folder is missing or unreadable.
        """
        return piece_names(self.folder)

    def path(self, name: str) -> Path:
        """Return the path of a piece's file, which need not exist."""
        return self.folder / f"{name}{PIECE_SUFFIX}"

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
        """Save a piece; it replaces another one of the same name.

        Args:
            score: The piece.
            name: Its name: letters, digits, hyphens and underscores.
            source: Source of the notes, in one line.
            fingering: Source of the fingering, in a word or two.
            collection: The piece's collection.
            **more: Further fields of `PieceInfo`: ``title``, by default the name; ``path``,
                ``sha256``, ``setting``, ``features``.

        Raises:
            ConfigError: If the name is invalid.
        """
        check_name(name)
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

    def remove(self, name: str) -> None:
        """Remove a piece, damaged or not.

        Raises:
            UnknownPieceError: If the library has no such piece.
        """
        self._check_known(name)
        self.path(name).unlink(missing_ok=True)

    def pieces(self) -> dict[str, Piece]:
        """Return all pieces by name, in alphabetical order; scores are made on demand."""
        return {name: self._piece(name) for name in self.names()}

    def info(self, name: str) -> PieceInfo:
        """Return the description of a piece.

        Raises:
            UnknownPieceError: If the library has no such piece.
            ScoreError: If its file is damaged or of a newer version.
        """
        self._check_known(name)
        return self._info(name)

    def infos(self) -> dict[str, PieceInfo]:
        """Return the descriptions of all undamaged pieces by name."""
        found = {}
        for name in self.names():
            with contextlib.suppress(ScoreError):
                found[name] = self._info(name)
        return found

    def score(self, name: str) -> Score:
        """Read a piece's score.

        Raises:
            UnknownPieceError: If the library has no such piece.
            ScoreError: If its file is damaged or of a newer version.
        """
        self._check_known(name)
        return read_piece(self.path(name))

    @contextlib.contextmanager
    def importing(self) -> Iterator[None]:
        """Lock the library against other imports; remove leftovers of a killed one.

        Raises:
            ConfigError: If another import into this library is running, or its folder is not
                writable.
        """
        with contextlib.ExitStack() as stack:
            try:
                busy = "another import is under way"
                stack.enter_context(hold(self.folder / LOCK_SUFFIX, busy, "one at a time."))
            except RunError as error:
                raise ConfigError(
                    f"Cannot keep pieces in '{self.folder}': {error} The environment variable "
                    f"{DATA_VARIABLE} may name another."
                ) from error
            for partial_file in self.folder.glob(f"*{PARTIAL_SUFFIX}"):
                partial_file.unlink(missing_ok=True)
            yield

    def _check_known(self, name: str) -> None:
        known = self.names()
        if name not in known:
            raise UnknownPieceError(
                f"The library in '{self.folder}' has no piece {name!r}."
                f"{near_names(name, known)} Expected a name from 'sb3-piano pieces list'."
            )

    def _info(self, name: str) -> PieceInfo:
        path = self.path(name)
        stat = path.stat() if path.exists() else None
        return _read_info(path, stat and (stat.st_mtime_ns, stat.st_size))

    def _piece(self, name: str) -> Piece:
        try:
            info = self._info(name)
        except ScoreError as error:
            info = PieceInfo(
                name=name,
                title=name,
                collection="imported",
                source=str(error),
                fingering="none",
            )
        return Piece(
            name=name,
            title=info.title,
            collection=info.collection,
            source=info.source,
            fingering=info.fingering,
            build=partial(read_piece, self.path(name)),
        )


@cache
def _read_info(path: Path, version: object) -> PieceInfo:
    del version  # time of change and size, so that the cache misses after a change
    return read_info(path)


def imported_pieces() -> dict[str, Piece]:
    """Return the imported pieces by name; none if their folder cannot be read."""
    return Library().pieces()


def piece_features(piece: Piece) -> Features:
    """Return a piece's features; for an imported piece, from its file if present.

    Raises:
        ScoreError: If its score cannot be made.
    """
    library = Library()
    noted = library.info(piece.name).features if piece.name in library else None
    # Another version may have other features.
    if noted is None or set(noted) != {field.name for field in fields(Features)}:
        return features(piece.score())
    return Features(**{**noted, "pitch_range": tuple(noted["pitch_range"])})
