"""The table that comes with the MAESTRO data set: composer and title of each file."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ScoreError


def read_titles(folder: Path) -> dict[Path, str]:
    """Return the titles of the files in a folder that has MAESTRO's table, ``maestro-v3.0.0.csv``.

    The table is also read in the form of JSON. It is sought in the folder itself; without one
    there are no titles.

    Raises:
        ScoreError: If there is such a table, but it cannot be read.
    """
    tables = sorted(folder.glob("maestro-v*.csv")) or sorted(folder.glob("maestro-v*.json"))
    if not tables:
        return {}
    table = tables[-1]
    try:
        text = table.read_bytes().decode("utf-8-sig")
        rows = _csv_rows(text) if table.suffix == ".csv" else _json_rows(json.loads(text))
        return {
            folder / row["midi_filename"]: f"{row['canonical_composer']}: {row['canonical_title']}"
            for row in rows
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, csv.Error) as error:
        raise ScoreError(
            f"Cannot read '{table}' ({type(error).__name__}: {error}): expected MAESTRO's table "
            "with canonical_composer, canonical_title and midi_filename."
        ) from error


def _csv_rows(text: str) -> Iterable[Mapping[str, str]]:
    return csv.DictReader(io.StringIO(text))


def _json_rows(content: Any) -> Iterable[Mapping[str, str]]:
    """Return the rows of a table that is written row by row (v2) or column by column (v3)."""
    if isinstance(content, list):
        return content
    return [
        {column: values[index] for column, values in content.items()}
        for index in content["midi_filename"]
    ]
