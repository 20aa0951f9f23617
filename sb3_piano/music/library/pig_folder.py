"""The folder of the PIG data set, as it is downloaded: which pieces it has, by RoboPianist's names.

``FingeringFiles/001-1_fingering.txt`` is the first annotator's fingering of piece 1, whose title is
in column ``Piece`` of the first row of ``List.csv``. The first annotation of each piece is taken.

The notes are kept as they are in the data, which has long notes where the pedal is held, and tempos
of its own. Only those without length, of which six pieces have some, get a very short one: that is
one control step, as in RoboPianist's piano roll.
"""

from __future__ import annotations

import csv
import io
import re
import tempfile
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.formats import read_pig
from sb3_piano.music.library.found import Found
from sb3_piano.music.library.pig_pieces import (
    ETUDE_COLLECTION,
    ETUDES,
    REPERTOIRE_COLLECTION,
)
from sb3_piano.music.score import Score

_FILES, _LIST = "FingeringFiles", "List.csv"
_FILE = re.compile(r"(\d+)-(\d+)_fingering\.txt")

_SHORTEST = 1e-6
"""Length of a note without length, in s: too short to reach into another control step."""


def find_pig_folder(path: Path) -> Path | None:
    """Return the folder of the data set at, directly in or directly around a path, if any."""
    inside = sorted(child for child in path.iterdir() if child.is_dir())
    for folder in (path, path.parent, *inside) if path.name == _FILES else (path, *inside):
        if (folder / _FILES).is_dir():
            return folder
    return None


def find_pig_pieces(folder: Path) -> list[Found]:
    """Return the first annotation of each piece.

    Raises:
        ScoreError: If there are no fingering files, or the list of titles cannot be read or does
            not name each piece.
    """
    files: dict[int, Path] = {}
    for path in sorted((folder / _FILES).glob("*.txt")):
        match = _FILE.fullmatch(path.name)
        if match is not None:
            files.setdefault(int(match[1]), path)
    if not files:
        raise ScoreError(
            f"'{folder / _FILES}' has no fingering files: expected names such as "
            "001-1_fingering.txt."
        )
    rows = _read_list(folder / _LIST)
    if max(files) > len(rows) or min(files) < 1:
        raise ScoreError(
            f"'{folder / _LIST}' has {len(rows)} pieces, but there are fingering files of pieces "
            f"{min(files)} to {max(files)}: expected a row for each."
        )
    return [_found(path, rows[number - 1]) for number, path in sorted(files.items())]


def robopianist_name(title: str) -> str:
    """Return RoboPianist's name for a title: ``"Waltz Op. 64 No. 1"`` as ``"WaltzOp64No1"``.

    Signs that an id cannot have are left out. What follows them stays a word of its own, and so
    does what follows a digit: ``"1st mov"`` becomes ``"1StMov"``.
    """
    words = re.sub(r"[ _-]", " ", re.sub(r"[.,']", "", title))
    return re.sub(r"\W", "", words.title())


def read_pig_piece(path: Path) -> Score:
    """Read a fingering file of the data set, in which notes may have no length.

    Raises:
        ScoreError: If the file cannot be read as a fingering file.
    """
    text = path.read_bytes()
    adapted = b"".join(map(_lengthen, text.splitlines(keepends=True)))
    if adapted == text:
        return read_pig(path)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        copy.write_bytes(adapted)
        try:
            return read_pig(copy)
        except ScoreError as error:
            raise ScoreError(str(error).replace(str(copy), str(path))) from error


def _found(path: Path, row: dict[str, str]) -> Found:
    title, composer = row["Piece"].strip(), (row.get("Composer") or "").strip()
    short = robopianist_name(title)
    names = [(f"{REPERTOIRE_COLLECTION}-{short}", REPERTOIRE_COLLECTION)]
    if short in ETUDES:
        names.append((f"{ETUDE_COLLECTION}-{short}", ETUDE_COLLECTION))
    return Found(
        path=path,
        title=f"{composer}: {title}" if composer else title,
        source=f"the PIG data set, {path.name}",
        names=tuple(names),
        labelled_by="PIG",
        fingering="keep",
        read=read_pig_piece,
    )


def _read_list(path: Path) -> list[dict[str, str]]:
    try:
        text = path.read_bytes().decode("utf-8-sig")
        rows = list(csv.DictReader(io.StringIO(text)))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ScoreError(
            f"Cannot read '{path}', the list of the PIG data set's pieces ({error}): expected a "
            "CSV file in UTF-8, as it was downloaded."
        ) from error
    if not rows or any(not row.get("Piece") for row in rows):
        raise ScoreError(f"'{path}' does not name each piece: expected a column Piece.")
    return rows


def _lengthen(line: bytes) -> bytes:
    """Return a line, whose note has a length; what is no note is left to the reader to refuse."""
    fields = line.split(maxsplit=3)
    if line.lstrip().startswith(b"//") or len(fields) < 4:
        return line
    try:
        onset, offset = float(fields[1]), float(fields[2])
    except ValueError:
        return line
    if onset != offset:
        return line
    fields[2] = repr(onset + _SHORTEST).encode()
    return b"\t".join(fields)
