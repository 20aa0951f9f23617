"""Several runs are evaluated, and one that fails takes no other with it."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import signal

import gymnasium as gym
import numpy as np
import pytest

from sb3_piano.exceptions import ConfigError, UnknownPieceError
from sb3_piano.training import compare, evaluate, evaluate_runs
from sb3_piano.training.evaluation.evaluate import Evaluations, Failure

STILL = np.zeros(39)


class Broken(gym.Wrapper):
    """Fail at the third step; named in a config by its import path."""

    steps = 0

    def step(self, action):
        self.steps += 1
        if self.steps == 3:
            raise ZeroDivisionError("of a wrapper")
        return self.env.step(action)


class Stopped(gym.Wrapper):
    """Press Ctrl-C at the third step; named in a config by its import path."""

    steps = 0

    def step(self, action):
        self.steps += 1
        if self.steps == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return self.env.step(action)


@pytest.fixture
def three_runs(pendulum_run):
    """Runs of three algorithms on Pendulum."""
    return [pendulum_run(algo, algo=algo) for algo in ("td3", "sac", "ddpg")]


def wrap(folder, wrapper):
    path = f"{__name__}.{wrapper.__name__}"
    folder.write_config(dataclasses.replace(folder.read_config(), env_wrapper=path))


def read_csv(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_each_run_is_evaluated_as_it_would_be_alone(three_runs):
    paths = [run.path for run in three_runs]
    found = evaluate_runs(paths, 2, [0, 3])
    assert found == Evaluations(evaluations=tuple(evaluate(path, 2, [0, 3]) for path in paths))
    assert [evaluation.algo for evaluation in found.evaluations] == ["td3", "sac", "ddpg"]


@pytest.mark.slow
def test_each_run_plays_each_given_piece_beside_its_baseline(piano_run):
    runs = [piano_run(STILL, name).path for name in ("one", "two")]
    pieces = ["TwinkleTwinkleLittleStar", "CMajorScaleOneHand"]
    found = evaluate_runs(runs, scores=pieces)
    played = [(evaluation.run, evaluation.piece) for evaluation in found.evaluations]
    assert played == [(run, piece) for run in runs for piece in pieces]
    lengths = {e.piece: e.baseline["length"] for e in found.evaluations}
    assert len(set(lengths.values())) == 2
    assert not any((run / "evaluation").exists() for run in runs)


@pytest.mark.slow
def test_the_csv_has_a_row_for_each_episode(three_runs, tmp_path):
    found = evaluate_runs([run.path for run in three_runs], 2, [7, 0])
    found.write_csv(tmp_path / "all.csv")
    rows = read_csv(tmp_path / "all.csv")
    names = ["run", "algo", "piece", "seed", "episode", "return", "length"]
    assert list(rows[0]) == names
    assert [(r["algo"], r["seed"], r["episode"]) for r in rows] == [
        (algo, seed, episode)
        for algo in ("td3", "sac", "ddpg")
        for seed in "70"
        for episode in "12"
    ]
    assert {row["piece"] for row in rows} == {"Pendulum-v1"}
    assert rows[4]["run"] == str(three_runs[1].path)
    returns = [e["return"] for evaluation in found.evaluations for e in evaluation.episodes]
    assert [float(row["return"]) for row in rows] == returns


def test_metrics_that_a_run_lacks_are_empty_in_the_csv(piano_run, pendulum_run, tmp_path):
    runs = [pendulum_run("pendulum").path, piano_run(STILL, "piano").path]
    evaluate_runs(runs).write_csv(tmp_path / "all.csv")
    pendulum, piano = read_csv(tmp_path / "all.csv")
    assert pendulum["f1"] == ""
    assert 0 <= float(piano["f1"]) <= 1


def test_the_json_has_everything_and_can_be_compared(three_runs, tmp_path):
    td3, sac, _ = three_runs
    found = evaluate_runs([td3.path, tmp_path / "nix"], 3)
    file = tmp_path / "td3.json"
    found.write_json(file)
    content = json.loads(file.read_text())
    assert content["evaluations"] == [json.loads(json.dumps(found.evaluations[0].to_json()))]
    assert content["evaluations"][0]["interval"]["return"] is not None
    assert content["failures"][0]["run"] == str(tmp_path / "nix")
    assert content["interrupted"] is False
    other = evaluate(sac.path, 3)
    (pair,) = compare(file, sac.path).metrics[0].pairs
    assert pair.a == pytest.approx(found.evaluations[0].mean["return"])
    assert pair.b == pytest.approx(other.mean["return"])


def test_a_run_that_fails_is_named_and_the_others_are_evaluated(three_runs, tmp_path, caplog):
    td3, sac, ddpg = three_runs
    wrap(sac, Broken)
    ddpg.model_file.write_bytes(b"PK")
    found = evaluate_runs([tmp_path / "nix", sac.path, ddpg.path, td3.path])
    assert [evaluation.run for evaluation in found.evaluations] == [td3.path]
    missing, broken, damaged = map(str, found.failures)
    assert missing.startswith(f"Run '{tmp_path / 'nix'}' was not evaluated: There is no folder")
    assert broken == f"Run '{sac.path}' was not evaluated: ZeroDivisionError('of a wrapper')"
    assert "cannot be loaded" in damaged
    assert not found.interrupted
    # what nobody expected is logged with its traceback, the rest is not
    assert [record.exc_info[0] for record in caplog.records] == [ZeroDivisionError]


@pytest.mark.slow
def test_a_piece_that_one_run_cannot_play_is_named(piano_run, pendulum_run):
    runs = [pendulum_run("pendulum").path, piano_run(STILL, "piano").path]
    found = evaluate_runs(runs, scores=["CMajorScaleOneHand"])
    assert [evaluation.run for evaluation in found.evaluations] == [runs[1]]
    assert "was not evaluated on 'CMajorScaleOneHand': " in str(found.failures[0])
    assert found.failures[0] == Failure(
        run=runs[0], piece="CMajorScaleOneHand", reason=found.failures[0].reason
    )


def test_ctrl_c_keeps_what_was_played_until_then(three_runs, ctrl_c):
    td3, sac, ddpg = three_runs
    wrap(sac, Stopped)
    found = evaluate_runs([td3.path, sac.path, ddpg.path], 2)
    assert found.interrupted
    assert [evaluation.run for evaluation in found.evaluations] == [td3.path]
    assert found.failures == ()


def test_ctrl_c_within_a_run_keeps_its_finished_episodes_and_starts_no_other(three_runs, ctrl_c):
    played = []

    def stop_after_five():
        played.append(1)
        if len(played) == 5:
            os.kill(os.getpid(), signal.SIGINT)

    runs = [run.path for run in three_runs]
    found = evaluate_runs(runs, 3, on_episode=stop_after_five)
    assert found.interrupted
    assert [len(evaluation.episodes) for evaluation in found.evaluations] == [3, 2]


def test_what_is_wrong_for_all_runs_is_refused_at_once(three_runs):
    runs = [run.path for run in three_runs]
    for changes, message in (
        ({"episodes": 0}, "episodes is 0: expected 1 or more"),
        ({"seeds": [0, 0]}, "seed 0 is given 2 times"),
    ):
        with pytest.raises(ConfigError, match=message):
            evaluate_runs(runs, **changes)
    with pytest.raises(UnknownPieceError, match="Unknown piece 'Twinkle'"):
        evaluate_runs(runs, scores=["Twinkle"])
    with pytest.raises(ConfigError, match="td3' is given twice: expected each run once"):
        evaluate_runs([*runs, runs[1].parent / "td3" / "." / "."])
