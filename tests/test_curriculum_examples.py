"""Tables of the pages about trainings are those of the results that are kept."""

import re
from pathlib import Path

import pytest
from fresh_python import run_python

from sb3_piano.training import compare

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "reproductions"
LEARNING = ROOT / "docs" / "learning.md"
CURRICULUM = "curriculum.md"
KEPT = ROOT / "examples" / "curriculum" / "kept"


def rows_of(arguments, folder):
    """Return the rows of the table that a command prints."""
    ended = run_python(arguments, folder)
    assert ended.returncode == 0, ended.stderr
    rows = [line for line in ended.stdout.splitlines() if line.startswith("| ")]
    assert len(rows) > 1
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


def rows_of_study(study, folder):
    """Return the rows of the trainings that are kept."""
    learning = ROOT / "benchmarks" / "learning"
    command = [str(learning.with_suffix(".py")), str(learning / f"{study}.yml")]
    rows = rows_of([*command, "--out", str(learning / "kept" / study), "--report"], folder)
    return [row.replace("**", "") for row in rows]


@pytest.mark.parametrize("study", ["hanon", "fingerings", "fingerings_chromatic"])
def test_studies_of_curricula(study, tmp_path):
    page = (PAGES / CURRICULUM).read_text("utf-8").replace("**", "")
    for row in rows_of_study(study, tmp_path):
        f1, _, onset_f1, fingers = map(str.strip, row.split("|")[7:11])
        assert f"| {f1} | {onset_f1} | {fingers} |" in page, row


@pytest.mark.parametrize("study", ["from_nothing", "unseen", "algorithms", "from_planned"])
def test_what_learns(study, tmp_path):
    page = LEARNING.read_text("utf-8").replace("**", "")
    for row in rows_of_study(study, tmp_path):
        assert row in page


def test_a_tree_of_the_sight_reader(tmp_path):
    page = (PAGES / "tree_search.md").read_text("utf-8")
    script = ROOT / "benchmarks" / "planned_pianist.py"
    columns = ["planned", "sight-reader", "sight-reader-tree"]
    kept = ["--out", str(ROOT / "docs" / "planned_pianist.csv"), "--pieces", "none"]
    (row,) = (
        row
        for row in rows_of([str(script), "--columns", *columns, *kept], tmp_path)
        if "all of repertoire" in row
    )
    assert row in page


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
