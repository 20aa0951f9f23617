"""Tables of the pages about curriculum strategies are those of the results that are kept."""

import re
import shutil
from pathlib import Path

import pytest
from fresh_python import run_python

from sb3_piano.training import compare

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "reproductions"
LEARNING = "../learning.md"
CURRICULUM = "curriculum.md"
KEPT = ROOT / "examples" / "curriculum" / "kept"


def rows_of(arguments, folder):
    """Return the rows of the table that a command prints."""
    ended = run_python(arguments, folder)
    assert ended.returncode == 0, ended.stderr
    rows = [line for line in ended.stdout.splitlines() if line.startswith("| ")]
    assert len(rows) > 2
    return [as_on_pages(row) for row in rows[1:]]


def as_on_pages(text):
    """Return text with shares as the pages have them, .25 for 0.25."""
    return re.sub(r"\b0\.(?=\d\d)", ".", text)


def test_trees(tmp_path):
    page = (PAGES / "tree_search.md").read_text("utf-8")
    script = ROOT / "examples" / "curriculum" / "tree.py"
    for row in rows_of([str(script), "--report", str(KEPT / "tree.json")], tmp_path):
        assert row in page


def test_easier_pieces_first(tmp_path):
    page = (PAGES / CURRICULUM).read_text("utf-8").replace("**", "")
    page = page.replace("| Clair de lune |", "| ClairDeLune |")
    page = page.replace("| Maple Leaf Rag |", "| MapleLeafRag |")
    script = ROOT / "examples" / "curriculum" / "transfer.py"
    for row in rows_of([str(script), "--report", str(KEPT / "transfer.json")], tmp_path):
        assert row in page


@pytest.mark.parametrize(
    ("study", "page"),
    [
        ("hanon", CURRICULUM),
        ("fingerings", CURRICULUM),
        ("fingerings_chromatic", CURRICULUM),
        ("algorithms", LEARNING),
    ],
)
def test_studies(study, page, tmp_path):
    page = (PAGES / page).read_text("utf-8").replace("**", "").replace(" floor |", " |")
    learning = ROOT / "benchmarks" / "learning"
    shutil.copytree(learning / "kept" / study, tmp_path / study)
    command = [str(learning.with_suffix(".py")), str(learning / f"{study}.yml")]
    for row in rows_of([*command, "--out", str(tmp_path / study), "--report"], tmp_path):
        _, name, _, _, _, _, f1, _, onset_f1, fingers, _ = map(str.strip, row.split("|"))
        assert f"| {f1} | {onset_f1} | {fingers} |" in page, name


def test_choices_of_pieces(tmp_path):
    page = (PAGES / "tree_search.md").read_text("utf-8")
    files = sorted(str(file) for file in KEPT.glob("choice/*.json"))
    assert len(files) == 2
    script = ROOT / "examples" / "curriculum" / "choice.py"
    for row in rows_of([str(script), *files], tmp_path):
        assert row in page


def test_differences_of_choices():
    page = (PAGES / "tree_search.md").read_text("utf-8")
    (row,) = (line for line in page.splitlines() if line.startswith("| here | +"))
    uniform, replay = (KEPT / "choice" / f"{name}.json" for name in ("uniform", "level_replay"))
    found = compare(uniform, replay, ["onset_f1", "f1", "non_silent_f1"]).metrics
    for metric in found:
        mean, interval = metric.difference.mean, metric.difference.interval
        text = f" {mean:+.3f} [{interval[0]:+.3f}, {interval[1]:+.3f}] "
        assert as_on_pages(text) in row
    assert f" {found[0].n_a_not_above_b} of {len(found[0].pairs)} " in row
