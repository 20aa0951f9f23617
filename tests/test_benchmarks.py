"""Benchmarks: of the planned pianist, of learning curves, and what experiments at scale take."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest
import yaml
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import load_score

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
DOCS = BENCHMARKS.parent / "docs"


def load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # where annotations of its classes are looked up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def table():
    return load(BENCHMARKS / "planned_pianist.py")


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


def test_the_table_of_the_page_is_that_of_the_file_beside_it(table, capsys):
    rows = table.read_rows(DOCS / "planned_pianist.csv")
    assert len({piece for piece, _ in rows}) == 99
    page = (DOCS / "planned_pianist_results.md").read_text(encoding="utf-8").splitlines()
    heading = next(line for line in page if line.startswith("| group |"))
    columns = heading.strip("| ").split(" | ")[4:]
    assert columns[:2] == ["planned", "sight-reader"]
    table.print_table(rows, columns)
    printed = capsys.readouterr().out.splitlines()
    first = page.index(heading)
    assert page[first : first + 9] == printed[-9:]
    assert page[first + 8].startswith("| all pieces | 99 |")


# What large experiments take is computed from named costs, and the page shows what comes out.


@pytest.fixture(scope="module")
def scale():
    return load(DOCS / "building" / "scale.py")


def test_the_table_of_the_page_is_what_the_script_computes(scale):
    assert f"\n{scale.table()}\n" in (DOCS / "at_scale.md").read_text(encoding="utf-8")


# The benchmark of learning curves.


learning = vars(load(BENCHMARKS / "learning.py"))

STUDY = Tables(__file__)["study"]


@pytest.mark.parametrize(
    "file", sorted((BENCHMARKS / "learning").glob("*.yml")), ids=lambda f: f.stem
)
def test_the_studies_of_the_repository_have_valid_settings(file, tmp_path):
    study = learning["Study"].from_yaml(file, tmp_path)
    piece, seed = study.pieces[0], 1
    for variant in study.variants.values():
        if "{piece}" in (variant.player or ""):  # a run that a user makes first
            with pytest.raises(ConfigError, match=f"clones/{piece.name}/cloned"):
                variant.config(piece, seed)
        else:
            assert variant.config(piece, seed).seed == seed


@pytest.mark.slow
def test_a_study_trains_until_its_time_is_up_and_what_is_whole_is_not_done_again(tmp_path, capsys):
    file = tmp_path / "study.yml"
    brief = {"envs": [], "pieces": ["TwinkleTwinkle"], "seconds": 1}
    file.write_text(yaml.safe_dump({**STUDY, **brief}))
    out = tmp_path / "out"
    study = learning["Study"].from_yaml(file, out / "pieces")
    for name, piece, seed in study.cells():
        made = learning["file_of"](out, name, piece, seed)
        learning["run"]((study.variants[name], piece, seed, study, made))
        rows = [json.loads(line) for line in made.read_text().splitlines()]
        assert [row["steps"] for row in rows] == sorted({row["steps"] for row in rows})
        assert rows[0]["steps"] == 0 < rows[-1]["cpu_seconds"]
        assert all(0 <= row[metric] <= 1 for row in rows for metric in ("f1", "onset_f1"))
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.jsonl")}
    assert len(before) == 4
    learning["main"]([str(file), "--out", str(out)])
    assert before == {path: path.stat().st_mtime_ns for path in out.rglob("*.jsonl")}
    printed = capsys.readouterr().out
    assert "| strikes | TwinkleTwinkle | 2 |" in printed
    assert (out / "curves.png").stat().st_size > 10_000


def test_a_study_takes_the_first_seconds_of_its_pieces_and_reports_what_has_ended(tmp_path, capsys):
    file = tmp_path / "study.yml"
    file.write_text(yaml.safe_dump({**STUDY, "pieces": ["FurElise"], "seconds": 3}))
    whole, piece = learning["Study"].from_yaml(file, tmp_path / "pieces").pieces
    assert whole.env_id == STUDY["envs"][0]
    score = load_score(piece.env_kwargs["score"])
    assert piece.name == "FurElise"
    assert score.duration == pytest.approx(3, abs=0.05)
    assert [note.pitch for note in score.notes[:4]] == [
        note.pitch for note in load_score("FurElise").notes[:4]
    ]
    with pytest.raises(SystemExit):
        learning["main"]([str(file), "--out", str(tmp_path / "out"), "--report"])
    assert "expected one that has ended" in capsys.readouterr().err
    file.write_text(yaml.safe_dump({**STUDY, "variants": {"own": {"algorithm": "td3"}}}))
    with pytest.raises(SystemExit):
        learning["main"]([str(file), "--out", str(tmp_path / "out")])
    assert "Unknown setting 'algorithm'" in capsys.readouterr().err
