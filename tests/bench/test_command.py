"""``sb3-piano bench``: the table, the file, and what goes wrong."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys

import pytest

import sb3_piano.bench
from sb3_piano.cli import main

asked: dict[str, object] = {}


@pytest.fixture(autouse=True)
def _short(monkeypatch, short, tmp_path):
    monkeypatch.chdir(tmp_path)

    def settings(*, rounds, **given):
        asked.update(given, rounds=rounds)
        return short(rounds=min(rounds, 2), **given)

    asked.clear()
    monkeypatch.setattr(sb3_piano.bench, "BenchSettings", settings)


def test_the_table_is_printed_and_written(tmp_path, capsys):
    command = ["bench", "--only", "memory", "--only", "simulation", "--rounds", "2"]
    assert main([*command, "--json", "result.json"]) == 0
    captured = capsys.readouterr()
    assert "RoboPianist-debug-CMajorScaleTwoHands-v0" in captured.out
    assert captured.out.endswith("Result: result.json\n")
    assert "simulation" in captured.err  # the progress bar
    stored = json.loads((tmp_path / "result.json").read_text())
    assert {row["part"] for row in stored["rows"]} == {"simulation", "memory"}
    for row in stored["rows"]:
        (line,) = (line for line in captured.out.splitlines() if f"│ {row['name']} " in line)
        assert abs(float(line.split("│")[2]) / row["value"] - 1) < 0.01


def test_options_reach_the_measurement():
    assert main(["bench", "--only", "memory", "--rounds", "3", "--num-threads", "2"]) == 0
    assert asked == {"parts": ("memory",), "rounds": 3, "peer_python": None, "num_threads": 2}


def test_everything_is_measured_by_default(monkeypatch):
    report = sb3_piano.bench.run_bench(sb3_piano.bench.BenchSettings(rounds=1, parts=()))
    monkeypatch.setattr(sb3_piano.bench, "run_bench", lambda settings, tick: report)
    assert main(["bench"]) == 0
    parts = ("simulation", "learner", "memory")
    assert asked == {"parts": parts, "rounds": 10, "peer_python": None, "num_threads": None}


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_prints_and_writes_what_there_is(monkeypatch, tmp_path, capsys):
    @contextlib.contextmanager
    def bar():
        yield lambda part, done, laps: done == 25 and os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(sb3_piano.bench, "progress_bar", bar)
    assert main(["bench", "--only", "simulation", "--json", "result.json"]) == 130
    assert "Interrupted" in capsys.readouterr().out
    stored = json.loads((tmp_path / "result.json").read_text())
    assert stored["interrupted"]
    # 10 laps to warm up and 10 of the first round
    assert [len(row["by_round"]) for row in stored["rows"]] == [1] * 10


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--peer-python nowhere", "The peer interpreter 'nowhere' cannot be started: No such file"),
        (f"--peer-python {sys.executable}", "pip install robopianist==1.0.10"),
        ("--peer-python x --only memory", "the simulation is not measured"),
        ("--json no/where.json", "--json is 'no/where.json': expected a file in a folder that ex"),
        ("--json .", "--json is '.': expected a file in a folder that exists."),
    ],
)
def test_an_error_is_one_line_on_stderr(arguments, message, capsys):
    assert main(["bench", *arguments.split()]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("sb3-piano: error: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1


def test_no_progress_leaves_stderr_empty(capsys):
    assert main(["bench", "--only", "simulation", "--rounds", "1", "--no-progress"]) == 0
    assert capsys.readouterr().err == ""


def test_parts_are_known_to_the_parser(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["bench", "--only", "speed"])
    assert "invalid choice: 'speed'" in capsys.readouterr().err
