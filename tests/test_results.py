"""The results in docs/results fit their schema, are of the pieces there are, and come out again."""

from __future__ import annotations

import importlib
import json
import random
import shlex
import sys
from pathlib import Path

import pytest
from pydantic import ValidationError

from sb3_piano.music import load_score
from sb3_piano.music.repertoire import REPERTOIRE

FOLDER = Path(__file__).parents[1] / "docs" / "results"
sys.path.insert(0, str(FOLDER))  # as where a script of the folder runs
measure = importlib.import_module("measure")
records = importlib.import_module("records")
sys.path.remove(str(FOLDER))

RESULTS = records.Results.read().results
QUICK = [result for result in RESULTS if result.cpu_seconds < 6]
AGAIN = random.Random(20261124).sample(QUICK, 3)
"""Results that are measured again, always the same ones as long as the file does not change."""

RESULT = {
    "piece": "repertoire-FurElise",
    "score_sha256": "0" * 64,
    "player": "planned",
    "physics": "reference",
    "seeds": [0, 1],
    "f1": [0.5, 0.7],
    "onset_f1": [0.25, 0.5],
    "noop_f1": 0.125,
    "cpu_seconds": 1.5,
    "package_version": "0.1.0",
    "hardware": "a processor",
    "command": "python docs/results/measure.py",
    "date": "2026-11-24",
}


def result(**changes):
    return records.Result.model_validate_json(json.dumps({**RESULT, **changes}))


def test_each_piece_of_the_repertoire_has_a_result_of_each_player():
    keys = {r.key for r in RESULTS}
    for player in ("planned", "sight-reader"):
        assert {(piece, player, "reference") for piece in REPERTOIRE} <= keys


def test_results_are_of_the_scores_that_the_package_has():
    for piece in {r.piece for r in RESULTS}:
        digests = {r.score_sha256 for r in RESULTS if r.piece == piece}
        assert digests == {measure.digest(load_score(piece))}, piece


def test_a_digest_changes_with_the_notes_and_not_with_the_title():
    score = load_score("FurElise")
    renamed = type(score)(notes=score.notes, pedals=score.pedals, title="another")
    assert measure.digest(renamed) == measure.digest(score)
    assert measure.digest(score.transpose(1)) != measure.digest(score)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"f1": [0.5]}, "f1 of 'repertoire-FurElise' by 'planned' has 1 values: expected one for"),
        ({"onset_f1": [0.5, 1.5]}, "less than or equal to 1"),
        ({"score_sha256": "abc"}, "should match pattern"),
        ({"physics": "exact"}, "'reference', 'faithful'"),
        ({"f2": 1}, "Extra inputs are not permitted"),
    ],
)
def test_a_result_that_does_not_fit_is_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        result(**changes)


def test_a_file_has_one_result_of_a_piece_a_player_and_a_physics():
    with pytest.raises(ValidationError, match="is there twice"):
        records.Results(results=(result(), result(f1=[0.1, 0.1])))


def test_a_file_of_another_schema_is_refused(tmp_path):
    file = tmp_path / "results.json"
    measure.write(records.Results(results=(result(),)), file)
    file.write_text(file.read_text().replace('"schema_version": 1', '"schema_version": 2'))
    with pytest.raises(ValidationError, match="schema_version"):
        records.Results.read(file)


def test_a_new_result_takes_the_place_of_the_old_one(tmp_path):
    old = records.Results(results=(result(), result(player="sight-reader")))
    merged = old.merged([result(f1=[0.9, 0.9])])
    assert [r.player for r in merged.results] == ["planned", "sight-reader"]
    assert merged.results[0].f1 == (0.9, 0.9)
    measure.write(merged, tmp_path / "results.json")
    assert records.Results.read(tmp_path / "results.json") == merged


def test_the_table_has_means_over_seeds_and_over_pieces_that_all_are_played():
    of_one = result(piece="repertoire-OdeToJoy", player="sight-reader", noop_f1=0.375)
    other = result(piece="repertoire-OdeToJoy", f1=[1, 1], onset_f1=[1, 1], noop_f1=0.375)
    assert records.score_table([result(), other, of_one]).splitlines() == [
        "| piece | nothing | planned | sight-reader |",
        "|---|---:|---:|---:|",
        "| repertoire-FurElise | 0.125 | 0.600 / 0.375 |  |",
        "| repertoire-OdeToJoy | 0.375 | 1.000 / 1.000 | 0.600 / 0.375 |",
        "| **mean** | 0.250 | 0.800 / 0.688 |  |",
    ]


@pytest.mark.slow
@pytest.mark.parametrize("known", AGAIN, ids=lambda r: f"{r.piece} {r.player}")
def test_the_command_of_a_result_measures_it_again(known, tmp_path):
    program, script, *arguments = shlex.split(known.command)
    assert (program, script) == ("python", "docs/results/measure.py")
    measure.main([*arguments, "--out", str(tmp_path / "again.json")])
    (again,) = records.Results.read(tmp_path / "again.json").results
    assert (again.key, again.score_sha256) == (known.key, known.score_sha256)
    assert again.seeds == known.seeds
    for name in ("f1", "onset_f1"):
        assert getattr(again, name) == pytest.approx(getattr(known, name), abs=0.01)
