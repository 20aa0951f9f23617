"""Find known data sets: PIG, and the snippets of RoboPianist's package.

The PIG data set (Nakamura, Saito and Yoshii 2020) may not be redistributed. RoboPianist names its
150 pieces by the titles in the data set's list. The names in ``pig.yml`` are known before the
import, the others only afterwards.

The file ``FingeringFiles/001-1_fingering.txt`` has the first annotator's fingering of piece 1,
whose title is in column ``Piece`` of the first row of ``List.csv``. Each piece is imported with its
first annotation. The notes are kept as in the data, which has long notes where the pedal is held,
and tempos of its own. Only notes without length, in six pieces, get a very short one: one control
step, as in RoboPianist's piano roll.

The two snippets by Rousseau are read from the user's own copy of RoboPianist: he permits them for
that benchmark, so this package cannot include them. Their fingers are a list in the code of
RoboPianist's library; it is parsed as data, and nothing is executed.
"""

from __future__ import annotations

import ast
import csv
import io
import re
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import pretty_midi

from sb3_piano.exceptions import ScoreError, UnknownPieceError, one_line
from sb3_piano.files import check_file, read_file, read_member, read_table
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering.agreement import pig_files
from sb3_piano.music.formats import read_midi, read_pig
from sb3_piano.music.library.store import Library
from sb3_piano.music.library.task import ImportTask
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score

_REPERTOIRE, _ETUDE = "repertoire-150", "etude-12"

_SITE = "https://beam.kisarazu.ac.jp/~saito/research/PianoFingeringDataset/"

_COLLECTIONS: dict[str, list[str]] = read_table(Path(__file__).with_name("pig.yml"))

_FILES, _LIST = "FingeringFiles", "List.csv"

_SHORTEST = 1e-6
"""Length of a note without length, in s: too short to reach into another control step."""


def _load(name: str) -> Score:
    library = Library()
    if name in library:
        return library.score(name)
    raise UnknownPieceError(
        f"Piece {name!r} is of the PIG data set, which is not imported yet and may not be passed "
        f"on: register at {_SITE}, unzip what you get, and import it with 'sb3-piano pieces "
        "import PianoFingeringDataset_v1.2'."
    )


def _piece(collection: str, short: str) -> Piece:
    name = f"{collection}-{short}"
    return Piece(
        name=name,
        # A space before each capital letter and number, but not within "2Nd" or "K279".
        title=re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=\d)(?=[A-Z][a-z]{2})", " ", short),
        collection=collection,
        source="the PIG data set, not imported yet",
        fingering="PIG",
        build=partial(_load, name),
    )


PIG_PIECES: Mapping[str, Piece] = MappingProxyType(
    {
        piece.name: piece
        for collection, names in _COLLECTIONS.items()
        for piece in (_piece(collection, short) for short in names)
    }
)
"""The pieces of the PIG data set by name; making one before its import explains how to get it."""


def find_dataset(path: Path) -> tuple[list[ImportTask], Path] | None:
    """Find the pieces of a data set at, inside or around a folder, or None.

    It also returns the folder whose files all belong to the data set.

    Raises:
        ScoreError: If the data set is incomplete.
    """
    inside = sorted(child for child in path.iterdir() if child.is_dir())
    for folder in (path, path.parent, *inside) if path.name == _FILES else (path, *inside):
        if (folder / _FILES).is_dir():
            return _pig_pieces(folder), folder
    snippets = _snippets(path, origin=path)
    return None if snippets is None else (snippets, path)


def _pig_pieces(folder: Path) -> list[ImportTask]:
    """List the first annotation of each piece."""
    files = {int(number): paths[0] for number, paths in pig_files(folder / _FILES).items()}
    rows = _read_list(folder / _LIST)
    if max(files) > len(rows) or min(files) < 1:
        raise ScoreError(
            f"'{folder / _LIST}' has {len(rows)} pieces, but there are fingering files of pieces "
            f"{min(files)} to {max(files)}: expected a row for each."
        )
    return [_pig_piece(path, rows[number - 1]) for number, path in sorted(files.items())]


def robopianist_name(title: str) -> str:
    """Convert a title to RoboPianist's name: ``"Waltz Op. 64 No. 1"`` to ``"WaltzOp64No1"``.

    Signs that an id cannot have are left out. The text after such a sign or a digit starts a new
    word: ``"1st mov"`` becomes ``"1StMov"``.
    """
    words = re.sub(r"[ _-]", " ", re.sub(r"[.,']", "", title))
    return re.sub(r"\W", "", words.title())


def _pig_piece(path: Path, row: dict[str, str]) -> ImportTask:
    title, composer = row["Piece"].strip(), (row.get("Composer") or "").strip()
    short = robopianist_name(title)
    names = [(f"{_REPERTOIRE}-{short}", _REPERTOIRE)]
    if short in _COLLECTIONS[_ETUDE]:
        names.append((f"{_ETUDE}-{short}", _ETUDE))
    return ImportTask(
        path=path,
        title=f"{composer}: {title}" if composer else title,
        source=f"the PIG data set, {path.name}",
        names=tuple(names),
        labelled_by="PIG",
        fingering="keep",
        read=partial(read_pig, shortest=_SHORTEST),
    )


def _read_list(path: Path) -> list[dict[str, str]]:
    try:
        text = read_file(path).decode("utf-8-sig")
        rows = list(csv.DictReader(io.StringIO(text)))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ScoreError(
            f"Cannot read '{path}', the list of the PIG data set's pieces ({error}): expected a "
            "CSV file in UTF-8, as it was downloaded."
        ) from error
    if not rows or any(not row.get("Piece") for row in rows):
        raise ScoreError(f"'{path}' does not name each piece: expected a column Piece.")
    return rows


_SNIPPET_FOLDER = "music/data/rousseau"
_LIBRARY = "music/library.py"

_MOST_BYTES = 2**20
"""Size limit: RoboPianist's files are small."""

_SNIPPETS = {
    "twinkle-twinkle-trimmed.mid": ("TwinkleTwinkleRousseau", "Twinkle Twinkle", False),
    "nocturne-trimmed.mid": ("NocturneRousseau", "Nocturne", True),
}
"""Name and title by file, and whether fingers of simultaneous notes are listed by ascending pitch
instead of the order of the file."""


def unpack_wheel(wheel: Path, folder: Path) -> list[ImportTask]:
    """Unpack the needed files of a wheel of RoboPianist; return its pieces.

    Raises:
        ScoreError: If it is not a wheel of RoboPianist.
    """
    try:
        check_file(wheel)
        with zipfile.ZipFile(wheel) as archive:
            for file in (_LIBRARY, *(f"{_SNIPPET_FOLDER}/{file}" for file in _SNIPPETS)):
                if f"robopianist/{file}" in archive.namelist():
                    place = folder / "robopianist" / file
                    place.parent.mkdir(parents=True, exist_ok=True)
                    place.write_bytes(read_member(archive, f"robopianist/{file}", _MOST_BYTES))
    except Exception as error:  # zipfile and zlib raise any error for a damaged archive
        raise ScoreError(f"Cannot read '{wheel}' as a wheel: {one_line(error)}.") from error
    found = _snippets(folder, origin=wheel)
    if found is None:
        raise ScoreError(
            f"'{wheel}' has no folder robopianist/{_SNIPPET_FOLDER}: expected a wheel of "
            "robopianist, as from 'pip download --no-deps robopianist'."
        )
    return found


def _snippets(folder: Path, origin: Path) -> list[ImportTask] | None:
    """Find the snippets of RoboPianist's package at or in a folder, or None without a package.

    Their sources name `origin`, the path from the user.
    """
    packages = (folder, folder / "robopianist")
    package = next((one for one in packages if (one / _SNIPPET_FOLDER).is_dir()), None)
    if package is None:
        return None
    found = [
        ImportTask(
            path=package / _SNIPPET_FOLDER / file,
            title=f"Rousseau: {title}",
            source=f"RoboPianist, {file} in {origin.name}",
            names=((f"debug-{name}", "debug"),),
            labelled_by="RoboPianist",
            read=partial(
                read_snippet, fingers=_read_fingers(package / _LIBRARY, title), by_pitch=by_pitch
            ),
        )
        for file, (name, title, by_pitch) in _SNIPPETS.items()
        if (package / _SNIPPET_FOLDER / file).is_file()
    ]
    if not found:
        raise ScoreError(
            f"'{package / _SNIPPET_FOLDER}' is empty: expected {', '.join(_SNIPPETS)}."
        )
    return found


def read_snippet(path: Path, *, fingers: tuple[int, ...], by_pitch: bool) -> Score:
    """Read a snippet, and label its notes if there are fingers.

    Fingers are in the order of onsets; for simultaneous notes, in ascending pitch if `by_pitch`,
    else in the order of the file.

    Raises:
        ScoreError: If the file cannot be read, or the numbers of fingers and notes differ.
    """
    score = read_midi(path)
    if not fingers:
        return score
    tracks = pretty_midi.PrettyMIDI(str(path)).instruments
    in_order = sorted(
        (note for track in tracks for note in track.notes),
        key=lambda note: (note.start, note.pitch if by_pitch else 0),
    )
    if len(fingers) != len(in_order):
        raise ScoreError(
            f"'{path}' has {len(in_order)} notes, but RoboPianist has {len(fingers)} fingers for "
            "it: expected as many."
        )
    finger_at = {
        (note.start, note.pitch): finger for note, finger in zip(in_order, fingers, strict=True)
    }
    notes = [replace(note, finger=finger_at[note.onset, note.pitch]) for note in score.notes]
    return replace(score, notes=tuple(notes))


def _read_fingers(library: Path, title: str) -> tuple[int, ...]:
    """Read the fingers listed in a function of RoboPianist's library; empty if it has none."""
    function = f"{title.lower().replace(' ', '_')}_rousseau"
    try:
        tree = ast.parse(read_file(library))
    except (OSError, SyntaxError, ValueError):
        return ()
    lists = (
        node.value.elts
        for outer in ast.walk(tree)
        if isinstance(outer, ast.FunctionDef) and outer.name == function
        for node in ast.walk(outer)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.List)
    )
    found = (
        tuple(i.value for i in items if isinstance(i, ast.Constant) and isinstance(i.value, int))
        for items in lists
    )
    return next((fingers for fingers in found if min(fingers, default=-1) > UNKNOWN_FINGER), ())
