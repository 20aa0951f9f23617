"""Files as programs write them, from public bug reports: each is read as its writer meant it.

``cases/*.yml`` has the right values by file name: notes as [pitch, onset, offset] in s, presses of
the pedal as [onset, offset], bars, and what a warning says, where one is due; else what the error
says.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import pytest
import yaml

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music import load_score

FOLDER = Path(__file__).parent / "cases"
CASES: dict[str, dict[str, Any]] = {
    name: case
    for table in sorted(FOLDER.glob("*.yml"))
    for name, case in (yaml.safe_load(table.read_text()) or {}).items()
}


READ = sorted(name for name, case in CASES.items() if "refused" not in case)
NEAR = 1.5e-3  # s


@pytest.mark.parametrize("name", READ)
def test_a_file_is_read_as_its_writer_meant_it(name: str) -> None:
    case = CASES[name]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        score = load_score(FOLDER / name)
    assert score.title == Path(name).stem
    read = [[note.pitch, note.onset, note.offset] for note in score.notes]
    expected = sorted(case["notes"], key=lambda note: (note[1], note[0]))
    assert [note[0] for note in read] == [note[0] for note in expected]
    for one, other in zip(read, expected, strict=True):
        assert one[1:] == pytest.approx(other[1:], abs=NEAR)
    pedals = [[pedal.onset, pedal.offset] for pedal in score.pedals]
    assert pedals == [pytest.approx(pedal, abs=NEAR) for pedal in case.get("pedals", [])]
    assert score.bars == pytest.approx(case.get("bars", score.bars), abs=NEAR)
    told = [str(w.message) for w in caught if issubclass(w.category, ScoreWarning)]
    assert len(told) == ("warns" in case), told
    assert re.search(case.get("warns", ""), "".join(told))


@pytest.mark.parametrize("name", sorted(CASES.keys() - READ))
def test_a_file_that_cannot_be_read_is_refused_by_its_path_and_reason(name: str) -> None:
    with pytest.raises(ScoreError, match=CASES[name]["refused"]) as error:
        load_score(FOLDER / name)
    assert str(FOLDER / name) in str(error.value)


def test_every_file_has_its_right_values() -> None:
    files = {path.name for path in FOLDER.iterdir() if path.suffix not in (".yml", ".md")}
    assert set(CASES) == files
