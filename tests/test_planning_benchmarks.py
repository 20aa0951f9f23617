"""The benchmarks of the planned pianist go on where they stopped, and compare like with like."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from sb3_piano.metrics.losses import Losses

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def load(name):
    spec = importlib.util.spec_from_file_location(name, BENCHMARKS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def table():
    return load("planned_pianist")


def row(table, piece, column, **values):
    zeros = dict.fromkeys(table.FIELDS, "0.5")
    return {**zeros, "piece": piece, "column": column, "problem": "", **values}


def test_what_is_in_the_file_is_not_measured_again(table, tmp_path, monkeypatch):
    path = tmp_path / "rows.csv"
    table.append_row(path, row(table, "scale-CMajor", "planned", problem='two, "three"\n'))
    table.append_row(path, row(table, "hanon-01", "zero"))
    with path.open("a") as file:
        file.write("hanon-02,zero,0.1")  # cut off in the middle
    table.append_row(path, row(table, "hanon-03", "zero"))
    known = table.read_rows(path)
    assert [piece for piece, _ in known] == ["scale-CMajor", "hanon-01", "hanon-03"]
    assert known["scale-CMajor", "planned"]["problem"] == 'two, "three"\n'
    monkeypatch.setattr(table, "ProcessPoolExecutor", None)  # nothing is started
    table.complete(path, known, jobs=1)
    with pytest.raises(TypeError):
        table.complete(path, [("hanon-02", "zero")], jobs=1)


def test_a_file_keeps_the_headings_that_it_was_begun_with(table, tmp_path):
    path = tmp_path / "older.csv"
    path.write_text("piece,column,f1\nhanon-01,planned,0.9\n", encoding="utf-8")
    table.append_row(path, row(table, "hanon-02", "planned", f1="0.8"))
    rows = table.read_rows(path)
    assert rows["hanon-02", "planned"] == {"piece": "hanon-02", "column": "planned", "f1": "0.8"}


def test_losses_are_shares_of_the_frames_that_are_due(table, capsys):
    due = {"all": {"sounding": 6, "never": 1, "early": 1}, "thumb": {"never": 1}}
    shares = table.losses(Losses(due=due, wrong={"all": {"neighbour": 2}}))
    assert shares["never"] == shares["early"] == "0.1250"
    assert shares["neighbour"] == "0.2500"
    assert shares["late"] == shares["other"] == "0.0000"
    rows = [row(table, "repertoire-FurElise", "planned", **shares)]
    old = {"piece": "repertoire-OdeToJoy", "column": "planned", "f1": "0.9", "onset_f1": "0.9"}
    table.print_losses({(r["piece"], r["column"]): r for r in [*rows, old]}, ["planned"])
    *_, line = capsys.readouterr().out.splitlines()
    assert line.startswith("| FurElise | planned | **0.500** / 0.500 | 12.5 | 0.0 | 12.5 |")


def test_means_are_over_pieces_that_all_columns_have(table, capsys):
    rows = [
        row(table, "repertoire-FurElise", "planned", f1="0.4", cpu="2"),
        row(table, "repertoire-OdeToJoy", "planned", f1="0.8", cpu="4"),
        row(table, "repertoire-FurElise", "zero", f1="0.1"),
    ]
    table.print_table({(r["piece"], r["column"]): r for r in rows}, ["planned", "zero"])
    lines = capsys.readouterr().out.splitlines()
    group = next(line for line in lines if line.startswith("| all of repertoire "))
    assert "**0.600**" in group
    assert "/ 3.0 |" in group
    assert group.endswith("| - |")


def test_the_table_of_the_page_is_that_of_the_file_beside_it(table, capsys):
    docs = BENCHMARKS.parent / "docs"
    rows = table.read_rows(docs / "planned_pianist.csv")
    assert len({piece for piece, _ in rows}) == 99
    page = (docs / "planned_pianist.md").read_text(encoding="utf-8").splitlines()
    heading = next(line for line in page if line.startswith("| group |"))
    columns = heading.strip("| ").split(" | ")[4:]
    assert columns[:2] == ["planned", "sight-reader"]
    table.print_table(rows, columns)
    printed = capsys.readouterr().out.splitlines()
    first = page.index(heading)
    assert page[first : first + 9] == printed[-9:]
    assert page[first + 8].startswith("| all pieces | 99 |")
