"""The drivers that compare curricula: what they train, and that finished work is kept."""

import dataclasses
import importlib
import json
import runpy
import sys
from pathlib import Path

import pytest

from sb3_piano.callbacks import Checkpoint
from sb3_piano.pipelines import load_curriculum, run_curriculum
from sb3_piano.training import RunFolder, StartFromRun
from sb3_piano.wrappers import HandReward

FOLDER = Path(__file__).parents[1] / "examples" / "curriculum"


@pytest.fixture
def driver(monkeypatch):
    """Return a function that imports a driver as the command line does."""
    monkeypatch.syspath_prepend(str(FOLDER))
    names = ("transfer", "seeds")
    yield importlib.import_module
    for name in names:
        sys.modules.pop(name, None)


@pytest.mark.slow
def test_a_chain_trains_each_stage_from_the_one_before_and_is_kept(driver, tmp_path):
    transfer = driver("transfer")
    assert transfer.PIECES == ("TwinkleTwinkle", "Reverie", "ClairDeLune", "MapleLeafRag")
    piece = "CMajorChordProgressionTwoHands"
    chain = transfer.Chain("alone", (piece, piece), seed=3, runs=tmp_path, steps=32)
    name, found = transfer.trained(chain)
    assert name == "alone"
    assert list(found) == [(piece, 1), (piece, 2)]
    assert all({*transfer.COLUMNS} <= {*metrics} for metrics in found.values())
    runs = [tmp_path / "alone_seed_3" / f"{number}_{piece}" for number in (1, 2)]
    first, second = (Checkpoint.read(run / "checkpoint").num_timesteps for run in runs)
    assert first == 32
    assert second == 256  # what starts from a run fills a batch with it before it learns
    assert "StartFromRun" in (runs[1] / "config.yml").read_text(encoding="utf-8")
    written = [(run / "model.zip").stat().st_mtime_ns for run in runs]
    assert transfer.trained(chain) == (name, found)
    assert [(run / "model.zip").stat().st_mtime_ns for run in runs] == written
    anew = dataclasses.replace(chain, name="anew", pieces=(piece,), start=runs[1])
    assert list(transfer.trained(anew)[1]) == [(piece, 1)]
    (start,) = (
        plugin.kwargs
        for plugin in RunFolder(tmp_path / "anew_seed_3" / f"1_{piece}").read_config().callback
        if plugin.is_a(StartFromRun)
    )
    assert start == {"run": str(runs[1]), "with_entropy": False}


def test_a_report_has_the_mean_the_least_and_the_greatest_of_each_cell(driver, capsys):
    transfer = driver("transfer")
    found = {}
    for name in ("stages", *transfer.TARGETS, *(f"{piece}_anew" for piece in transfer.TARGETS)):
        keys = [(piece, number) for piece in transfer.PIECES for number in range(1, 5)]
        value = 0.5 if name == "stages" else 0.25
        found[name] = [dict.fromkeys(keys, dict.fromkeys(transfer.COLUMNS, v)) for v in (0, value)]
    transfer.print_table(json.loads(json.dumps(transfer.rows_of(found))))
    rows = capsys.readouterr().out.splitlines()[2:]
    assert len(rows) == 8
    assert rows[0].startswith("| ClairDeLune | after easier ones | 0.250 [0.000, 0.500] |")
    assert rows[1].startswith("| ClairDeLune | after them, exploring anew | 0.125 [0.000, 0.250] |")


@pytest.mark.slow
def test_a_study_trains_on_from_what_practice_has_learnt(tmp_path, monkeypatch):
    monkeypatch.chdir(FOLDER.parents[1])
    practice = load_curriculum(FOLDER / "practice.yml")
    tiny = {"n_timesteps": 16}
    stages = [
        dataclasses.replace(stage, until=None, settings={**stage.settings, **tiny})
        for stage in practice.stages
    ]
    short = dataclasses.replace(practice, stages=tuple(stages), seed=1)
    *_, last = run_curriculum(short, tmp_path / "practice", progress_bar=False)
    learning, study = hanon(tmp_path)
    variant = dataclasses.replace(
        study.variants["Hanon, weight 0"],
        start=str(last.job.folder),
        settings={**study.variants["Hanon, weight 0"].settings, **tiny},
    )
    file = tmp_path / "of_seed_1.jsonl"
    learning["run"]((variant, study.pieces[0], 1, study, file))
    first, *_, end = (json.loads(row)["steps"] for row in file.read_text().splitlines())
    assert first == 0 < end


def hanon(folder):
    """Return the module of the studies, and that of Hanon before a piece."""
    root = FOLDER.parents[1]
    learning = runpy.run_path(str(root / "benchmarks" / "learning.py"))
    file = root / "benchmarks" / "learning" / "hanon.yml"
    return learning, learning["Study"].from_yaml(file, folder)


def test_what_begins_with_hanon_begins_where_practice_of_its_seed_ends(tmp_path):
    _, study = hanon(tmp_path)
    practice = load_curriculum(FOLDER / "practice.yml")
    for name, variant in study.variants.items():
        config = variant.config(study.pieces[0], 2)
        (last,) = config.callback
        starts = last.is_a(StartFromRun)
        assert starts == name.startswith("Hanon")
        if starts:
            assert last.kwargs == {"run": f"runs/practice/2/{practice.run_names[-1]}"}
        (reward,) = (one for one in config.env_wrapper if one.is_a(HandReward))
        assert reward.kwargs.get("fingering", 1.0) == float(name[-1])


def test_figures_over_seeds_are_the_mean_the_least_and_the_greatest(driver):
    over_seeds = driver("seeds").over_seeds
    assert over_seeds([0.25]) == "0.250"
    assert over_seeds([0.0, 0.5]) == "0.250 [0.000, 0.500]"
    assert over_seeds([2.0, 4.0]) == "3.0 [2.0, 4.0]"
    assert over_seeds([90.0, 110.4]) == "100 [90, 110]"
    assert over_seeds([]) == "-"
