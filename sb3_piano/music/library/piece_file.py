"""Read and write the file of an imported piece: its exact score and its description.

The file is a NumPy archive (.npz) without pickled objects. Its array ``header`` holds UTF-8 JSON.
Times are the score's own 64-bit floats, so a score read back is equal bit by bit. The archive's
checksums detect damage.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sb3_piano.array_files import read_arrays
from sb3_piano.arrays import Arrays
from sb3_piano.exceptions import ScoreError, one_line
from sb3_piano.files import write_bytes
from sb3_piano.music.hands import HANDS
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.score import Score

T = TypeVar("T")

_MOST_BYTES = 2**24
"""Most bytes of a file, and of its arrays; a note takes less than 32."""

_FORMAT = 1
"""Version of the format; increase it when older code cannot read new files."""


@dataclass(frozen=True, kw_only=True)
class PieceInfo:
    """Description of an imported piece, without its notes.

    Attributes:
        name: Its name in the library, and the title of its score.
        title: Its readable title.
        collection: Its collection; ``"imported"`` unless it is part of a data set.
        source: Source of its notes, in one line.
        fingering: Source of its fingering, in a word or two.
        path: The file of its import; empty without one.
        sha256: Checksum of that file's content, in hexadecimal digits.
        setting: The value of ``fingering`` at its import.
        n_notes: Number of notes.
        duration: Offset of its last note, in s.
        features: Its features of difficulty by name, or None if unknown.
    """

    name: str
    title: str
    collection: str
    source: str
    fingering: str
    path: str = ""
    sha256: str = ""
    setting: str = ""
    n_notes: int = 0
    duration: float = 0.0
    features: Mapping[str, Any] | None = None


def write_piece(path: Path, score: Score, info: PieceInfo) -> None:
    """Write a piece's file atomically."""
    header = json.dumps({"format": _FORMAT, **asdict(info)}).encode()
    buffer = io.BytesIO()
    np.savez_compressed(buffer, header=np.frombuffer(header, dtype=np.uint8), **_to_arrays(score))
    write_bytes(path, buffer.getvalue())


def read_info(path: Path) -> PieceInfo:
    """Read the description of a piece.

    Raises:
        ScoreError: If the file is missing, damaged, or written by a newer version.
    """
    return _read(path, ["header"], lambda info, arrays: info)


def read_piece(path: Path) -> Score:
    """Read the score in the file of an imported piece.

    Raises:
        ScoreError: If the file is missing, damaged, or written by a newer version.
    """
    return _read(path, None, lambda info, arrays: _from_arrays(arrays, info.name))


def _read(path: Path, names: list[str] | None, make: Callable[[PieceInfo, Arrays], T]) -> T:
    if not os.path.isfile(path):
        raise ScoreError(f"There is no imported piece {str(path)!r}: expected an existing file.")
    try:
        arrays = read_arrays(path, names, _MOST_BYTES)
        header = json.loads(arrays["header"].tobytes())
        version = header.pop("format")
        if version == _FORMAT:
            return make(PieceInfo(**header), arrays)
    except Exception as error:
        # zipfile, zlib, NumPy and json raise any error for a damaged archive.
        raise ScoreError(
            f"Imported piece {str(path)!r} is damaged ({one_line(error)}): remove "
            f"it with 'sb3-piano pieces remove {path.stem}' and import it again."
        ) from error
    raise ScoreError(
        f"Imported piece {str(path)!r} is of format {version!r}, which this version of sb3-piano "
        f"does not know: expected {_FORMAT}. Install a newer one, or remove the piece and import "
        "it again."
    )


_COLUMNS = {
    "onset": np.float64,
    "offset": np.float64,
    "pitch": np.uint8,
    "velocity": np.uint8,
    "finger": np.int8,
}
"""Types of the arrays, one for each field of a note."""


def _to_arrays(score: Score) -> dict[str, Any]:
    columns = {
        name: np.array([getattr(note, name) for note in score.notes], dtype=dtype)
        for name, dtype in _COLUMNS.items()
    }
    hands = [-1 if note.hand is None else HANDS.index(note.hand) for note in score.notes]
    pedals = [(pedal.onset, pedal.offset) for pedal in score.pedals]
    return {
        **columns,
        "hand": np.array(hands, dtype=np.int8),
        "pedals": np.array(pedals, dtype=np.float64).reshape(-1, 2),
        "bars": np.array(score.bars, dtype=np.float64),
    }


def _from_arrays(arrays: Arrays, name: str) -> Score:
    columns = [arrays[column].tolist() for column in _COLUMNS]
    hands = [None if hand < 0 else HANDS[hand] for hand in arrays["hand"].tolist()]
    return Score(
        notes=[
            Note(**dict(zip(_COLUMNS, values, strict=True)), hand=hand)
            for *values, hand in zip(*columns, hands, strict=True)
        ],
        pedals=[Pedal(onset=down, offset=up) for down, up in arrays["pedals"].tolist()],
        title=name,
        bars=arrays["bars"].tolist(),
    )
