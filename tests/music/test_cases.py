"""Files as programs write them, from public bug reports: each is read as its writer meant it.

``cases/*.yml`` has the right values by file name: notes as [pitch, onset, offset] in s, presses of
the pedal as [onset, offset], and what a warning says, where one is due.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest
import yaml

from sb3_piano.exceptions import ScoreWarning
from sb3_piano.music import load_score

FOLDER = Path(__file__).parent / "cases"
CASES: dict[str, dict[str, Any]] = {
    name: case
    for table in sorted(FOLDER.glob("*.yml"))
    for name, case in (yaml.safe_load(table.read_text()) or {}).items()
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_a_file_is_read_as_its_writer_meant_it(name: str) -> None:
    case = CASES[name]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        score = load_score(FOLDER / name)
    read = [[note.pitch, note.onset, note.offset] for note in score.notes]
    expected = sorted(case["notes"], key=lambda note: (note[1], note[0]))
    assert [note[0] for note in read] == [note[0] for note in expected]
    for one, other in zip(read, expected, strict=True):
        assert one[1:] == pytest.approx(other[1:], abs=1.5e-3)
    pedals = [[pedal.onset, pedal.offset] for pedal in score.pedals]
    assert pedals == [pytest.approx(pedal, abs=1.5e-3) for pedal in case.get("pedals", [])]
    told = [
        str(warning.message) for warning in caught if issubclass(warning.category, ScoreWarning)
    ]
    if "warns" in case:
        assert any(case["warns"] in text for text in told), told
    else:
        assert not told


def test_every_file_has_its_right_values() -> None:
    files = {path.name for path in FOLDER.iterdir() if path.suffix not in (".yml", ".md")}
    assert set(CASES) == files
