"""The two snippets by Rousseau that come with RoboPianist, from the user's own copy of it.

Rousseau permits them for RoboPianist's benchmark, which is why they do not come with this package.
RoboPianist's fingers for them are a list in the code of its library; it is read as data, without
running anything.
"""

from __future__ import annotations

import ast
import zipfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import pretty_midi

from sb3_piano.exceptions import ScoreError, one_line
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.formats import read_midi
from sb3_piano.music.formats.zip_file import read_member
from sb3_piano.music.library.found import Found
from sb3_piano.music.score import Score

_FOLDER = "music/data/rousseau"
_LIBRARY = "music/library.py"

_MOST_BYTES = 2**20
"""A larger file is none of RoboPianist's, which are small."""


_SNIPPETS = {
    "twinkle-twinkle-trimmed.mid": ("TwinkleTwinkleRousseau", "Twinkle Twinkle", False),
    "nocturne-trimmed.mid": ("NocturneRousseau", "Nocturne", True),
}
"""Name and title by the file, and whether the fingers of simultaneous notes are listed from the
lowest up, or else in the order of the file."""


def find_robopianist(folder: Path) -> Path | None:
    """Return the folder of RoboPianist's package at or in a folder, if any."""
    for package in (folder, folder / "robopianist"):
        if (package / _FOLDER).is_dir():
            return package
    return None


def unpack_wheel(wheel: Path, folder: Path) -> Path:
    """Unpack what is needed of a wheel of RoboPianist; return the folder of the package.

    Raises:
        ScoreError: If it is not a wheel of RoboPianist.
    """
    try:
        with zipfile.ZipFile(wheel) as archive:
            for file in (_LIBRARY, *(f"{_FOLDER}/{file}" for file in _SNIPPETS)):
                if f"robopianist/{file}" in archive.namelist():
                    place = folder / "robopianist" / file
                    place.parent.mkdir(parents=True, exist_ok=True)
                    place.write_bytes(read_member(archive, f"robopianist/{file}", _MOST_BYTES))
    except Exception as error:  # a damaged archive surfaces as whatever zipfile and zlib raise
        raise ScoreError(f"Cannot read '{wheel}' as a wheel: {one_line(error)}.") from error
    package = find_robopianist(folder)
    if package is None:
        raise ScoreError(
            f"'{wheel}' has no folder robopianist/{_FOLDER}: expected a wheel of robopianist, as "
            "from 'pip download --no-deps robopianist'."
        )
    return package


def find_snippets(package: Path, origin: Path) -> list[Found]:
    """Return the snippets in a folder of RoboPianist's package.

    Args:
        package: The folder.
        origin: What the user named, for the pieces' sources.

    Raises:
        ScoreError: If it has none.
    """
    found = [
        Found(
            path=package / _FOLDER / file,
            title=f"Rousseau: {title}",
            source=f"RoboPianist, {file} in {origin.name}",
            names=((f"debug-{name}", "debug"),),
            labelled_by="RoboPianist",
            read=partial(
                read_snippet, fingers=_read_fingers(package / _LIBRARY, title), by_pitch=by_pitch
            ),
        )
        for file, (name, title, by_pitch) in _SNIPPETS.items()
        if (package / _FOLDER / file).is_file()
    ]
    if not found:
        raise ScoreError(f"'{package / _FOLDER}' is empty: expected {', '.join(_SNIPPETS)}.")
    return found


def read_snippet(path: Path, *, fingers: tuple[int, ...], by_pitch: bool) -> Score:
    """Read a snippet, and give its notes fingers, if there are any.

    They are listed in the order of onsets, those of simultaneous notes from the lowest up if
    `by_pitch`, else in the order of the file.

    Raises:
        ScoreError: If the file cannot be read, or there are not as many fingers as notes.
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
    return Score(notes=notes, pedals=score.pedals, title=score.title, bars=score.bars)


def _read_fingers(library: Path, title: str) -> tuple[int, ...]:
    """Return the fingers that a function of RoboPianist's library lists; none if it does not."""
    function = f"{title.lower().replace(' ', '_')}_rousseau"
    try:
        tree = ast.parse(library.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return ()
    lists = [
        node.value.elts
        for outer in ast.walk(tree)
        if isinstance(outer, ast.FunctionDef) and outer.name == function
        for node in ast.walk(outer)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.List)
    ]
    for items in lists:
        values = [item.value for item in items if isinstance(item, ast.Constant)]
        fingers = tuple(value for value in values if isinstance(value, int))
        if fingers and all(finger > UNKNOWN_FINGER for finger in fingers):
            return fingers
    return ()
