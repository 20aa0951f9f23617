"""Select several pieces by names, patterns, collections, and lists in files."""

from __future__ import annotations

import fnmatch
import glob
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError, UnknownPieceError, near_names
from sb3_piano.files import read_file
from sb3_piano.music.catalogue import ScoreSource, find_piece, is_path, of_collection, pieces
from sb3_piano.music.formats.pig import looks_like_pig
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score

_LIST = ".txt"
_WILD = frozenset("*?[")
_COMMENT = re.compile(r"(^|\s)#.*")  # not the one in "Prelude in C# minor.mid"


def select_pieces(entries: Sequence[ScoreSource] | str | os.PathLike[str]) -> list[ScoreSource]:
    """Expand entries to pieces, in their order and without duplicates.

    Only lists are read, so selecting from a corpus of thousands is fast.

    Args:
        entries: One or more of: a score; the name of a piece; the path of a file; a pattern of
            names (``"scale-*"``) or of paths (``"corpus/**/*.mid"``), whose pieces are in
            alphabetical order; a collection (``"repertoire"``), as ``sb3-piano pieces list`` shows
            them; a text file, ``corpus.txt``, with such an entry in each line. Relative paths in
            it begin at its folder. ``#`` at the start of a line or after a space begins a
            comment.

    Returns:
        Scores, full names of pieces and absolute paths.

    Raises:
        ConfigError: If there is no entry, a list cannot be read, or nothing matches a pattern.
        UnknownPieceError: If no piece or collection has a name, or the piece is not imported yet.
    """
    single = isinstance(entries, str) or not isinstance(entries, Sequence)
    several: Sequence[Any] = [entries] if single else entries  # type: ignore[assignment]
    known, found = pieces(), dict[object, ScoreSource]()
    for entry in several:
        for piece in _selected(entry, Path(), known):
            found.setdefault(id(piece) if isinstance(piece, Score) else piece, piece)
    if not found:
        raise ConfigError(
            f"pieces is {entries!r}: expected one or more names, files, patterns such as "
            "'scale-*', collections or lists of these."
        )
    return list(found.values())


def _selected(entry: Any, folder: Path, known: Mapping[str, Piece]) -> Iterator[ScoreSource]:
    if isinstance(entry, Score):
        yield entry
        return
    if not isinstance(entry, str | os.PathLike):
        raise ConfigError(
            f"A piece cannot be given as {type(entry).__name__}: expected a Score, a name, or the "
            "path of a file."
        )
    text = os.fspath(entry)
    if text.endswith(_LIST) and not _WILD & set(text):
        yield from _listed(Path(os.path.abspath(folder / os.path.expanduser(text))), known)
    elif not isinstance(entry, str) or is_path(text):
        yield from _files(text, folder)
    elif _WILD & set(text):
        names = sorted(fnmatch.filter(known, text))
        if not names:
            raise ConfigError(
                f"No piece has a name like {text!r}: expected a pattern of names that "
                "'sb3-piano pieces list' shows."
            )
        yield from names
    else:
        yield from _named(text, known)


def _named(text: str, known: Mapping[str, Piece]) -> Iterator[str]:
    """Yield the piece of a name, or all pieces of a collection."""
    if text in known:
        yield text
        return
    if names := of_collection(known, text):
        yield from names
        return
    try:
        piece = find_piece(text)
    except UnknownPieceError as error:
        near = near_names(text, {piece.collection for piece in known.values()})
        raise UnknownPieceError(f"{error} No collection is called so either.{near}") from error
    if piece.name not in known:
        piece.score()  # raises an error that explains the import of the PIG data set
    yield piece.name


def _files(text: str, folder: Path) -> Iterator[str]:
    """Yield the absolute paths of a file, or of all files that match a pattern."""
    path = os.path.abspath(folder / os.path.expanduser(text))
    if not _WILD & set(text) or os.path.exists(path):  # a name may have brackets
        yield path
        return
    names = sorted(glob.glob(path, recursive=True))
    if not names:
        raise ConfigError(f"No file is at {path!r}: expected a pattern of files that are there.")
    yield from names


def _listed(path: Path, known: Mapping[str, Piece]) -> Iterator[ScoreSource]:
    """Yield the entries of a list in a file, or the file itself if it is a PIG piece."""
    try:
        content = read_file(path)
        if looks_like_pig(content):
            yield str(path)
            return
        lines = content.decode("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(
            f"The list of pieces '{path}' cannot be read: {reason}. Expected a text file with a "
            "name, a path or a pattern in each line."
        ) from error
    for number, line in enumerate(lines, start=1):
        entry = _COMMENT.sub("", line).strip()
        if entry.endswith(_LIST):
            raise ConfigError(
                f"'{path}', line {number}: {entry!r} is another list. Expected names, paths and "
                "patterns only."
            )
        if entry:
            yield from _selected(entry, path.parent, known)


def unique_titles(titles: Iterable[str]) -> list[str]:
    """Make titles unique by numbers: the second "a" becomes "a (2)"."""
    found: dict[str, None] = {}
    for title in titles:
        name, number = title, 2
        while name in found:
            name, number = f"{title} ({number})", number + 1
        found[name] = None
    return list(found)
