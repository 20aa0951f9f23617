"""A folder of imported pieces."""

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
"""Longest name, in bytes of UTF-8: file systems take 255, the suffix included."""

_NAME = re.compile(r"\w[\w-]*")


def slug(text: str) -> str:
    """Return a text as a name: ``"Für Elise (1810).2"`` as ``"Fur-Elise-1810-2"``.

    Letters lose their accents; whatever is neither letter, digit nor underscore becomes a hyphen.
    """
    decomposed = unicodedata.normalize("NFKD", text)
    letters = "".join(mark for mark in decomposed if not unicodedata.combining(mark))
    words = re.sub(r"[\W]+", "-", unicodedata.normalize("NFC", letters))
    return cut(words, LONGEST_NAME).strip("-_") or "piece"


def cut(text: str, size: int) -> str:
    """Return the beginning of a text that takes at most so many bytes."""
    return text.encode(errors="replace")[:size].decode(errors="ignore")


def is_built_in(name: str) -> bool:
    """Return whether a piece that comes with the package is called so, in full or in short."""
    return any(piece.name in (name, f"{piece.collection}-{name}") for piece in BUILT_IN.values())


def is_possible(name: str) -> bool:
    """Return whether a piece can have a name, if no other has it."""
    return _NAME.fullmatch(name) is not None and len(name.encode()) <= LONGEST_NAME


def check_name(name: str) -> None:
    """Refuse a name that a piece in the library cannot have.

    Raises:
        ConfigError: If it has other characters than an id takes, is too long, or belongs to a
            piece that comes with the package.
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
    """Pieces of the user's, one file each, in a folder.

    A file that is damaged, or of a newer version, spoils nothing but itself: its piece is listed,
    and making its score raises an error that names the file.
    """

    def __init__(self, folder: str | os.PathLike[str] | None = None) -> None:
        """Take a folder, which need not exist yet; by default the one for the user's pieces."""
        self.folder = pieces_folder() if folder is None else Path(folder)

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def names(self) -> tuple[str, ...]:
        """Return the names of all pieces, damaged or not, in alphabetical order.

        There are none if the folder is not there, or cannot be read.
        """
        return piece_names(self.folder)

    def path(self, name: str) -> Path:
        """Return the file of a piece, whether there is one or not."""
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
        """Keep a piece, in place of another one of the same name.

        Args:
            score: The piece.
            name: Its name: letters, digits, hyphens and underscores.
            source: Where the notes come from, in one line.
            fingering: Who chose the fingers, in a word or two.
            collection: What the piece belongs to.
            **more: Further fields of `PieceInfo`: ``title``, by default the name; ``path``,
                ``sha256``, ``setting``, ``features``.

        Raises:
            ConfigError: If a piece cannot have that name.
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
        """Return all pieces by name, in alphabetical order; each score is made when asked for."""
        return {name: self._piece(name) for name in self.names()}

    def info(self, name: str) -> PieceInfo:
        """Return what is known about a piece.

        Raises:
            UnknownPieceError: If the library has no such piece.
            ScoreError: If its file is damaged or of a newer version.
        """
        self._check_known(name)
        return self._info(name)

    def infos(self) -> dict[str, PieceInfo]:
        """Return what is known about each piece whose file is sound, by name."""
        found = {}
        for name in self.names():
            with contextlib.suppress(ScoreError):
                found[name] = self._info(name)
        return found

    def score(self, name: str) -> Score:
        """Return a piece's score.

        Raises:
            UnknownPieceError: If the library has no such piece.
            ScoreError: If its file is damaged or of a newer version.
        """
        self._check_known(name)
        return read_piece(self.path(name))

    @contextlib.contextmanager
    def importing(self) -> Iterator[None]:
        """Keep other imports out, and remove what one that was killed has left.

        Raises:
            ConfigError: If another import into this library is under way, or its folder cannot be
                written to.
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
    del version  # the time of change and the size, by which a file is read again after a change
    return read_info(path)


def imported_pieces() -> dict[str, Piece]:
    """Return the imported pieces by name; none if their folder cannot be read."""
    return Library().pieces()


def piece_features(piece: Piece) -> Features:
    """Return a piece's features; those of an imported one were noted in its file, if possible.

    Raises:
        ScoreError: If its score cannot be made.
    """
    library = Library()
    noted = library.info(piece.name).features if piece.name in library else None
    # Another version may have named others.
    if noted is None or set(noted) != {field.name for field in fields(Features)}:
        return features(piece.score())
    return Features(**{**noted, "pitch_range": tuple(noted["pitch_range"])})
