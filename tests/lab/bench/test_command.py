"""``sb3-piano bench``: the table, the file, and what goes wrong."""

import importlib.metadata
import json
import os
import platform
import signal
import socket
import sys

import pytest
import torch
from printed import rows_of
from rich.console import Console
from sb3_contrib import TQC
from stable_baselines3 import SAC, TD3
from yaml_rows import Tables

import sb3_piano.lab.bench
from sb3_piano.batch import PianoVectorEnv
from sb3_piano.cli import main
from sb3_piano.lab.bench import BenchReport, render
from sb3_piano.lab.bench.measurement import Row

tables = Tables(__file__)

CLASSES = {"sac": SAC, "td3": TD3, "tqc": TQC}


@pytest.fixture(autouse=True)
def _short(short, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def row(name, value, part="simulation", unit="steps/s", ratios=None, **more):
    return Row(part=part, name=name, value=value, unit=unit, ratios=ratios or {}, **more)


def shown(*rows, peer=None):
    """Return the lines of the table of a report."""
    console = Console(width=80)
    report = BenchReport(machine=tables["machine"], peer=peer, rows=rows, interrupted=False)
    with console.capture() as capture:
        console.print(render(report))
    return capture.get().splitlines()


@pytest.fixture
def trained(monkeypatch):
    """List of calls of ``train``: class, batch, observation, rows, precision, in our way or SB3's.

    All are of one update.
    """
    heard = []
    for kind in CLASSES.values():
        real = kind.train

        def train(model, gradient_steps, batch_size, real=real):
            size, rows = model.observation_space.shape[0], model.replay_buffer.size()
            precision = torch.get_float32_matmul_precision()
            how = "ours" if "forward" in vars(model.critic) else "SB3's"
            assert gradient_steps == 1
            heard.append((type(model), batch_size, size, rows, precision, how))
            real(model, gradient_steps=gradient_steps, batch_size=batch_size)

        monkeypatch.setattr(kind, "train", train)
    return heard


def expected_updates():
    """Return what is updated for each row of the learner's part: each preset, each observation."""
    expected = {}
    for algo, kind in CLASSES.items():
        sizes = {"roll": 1124, "window": 584, "fingers": 130, "hands": 758}
        for observation, size in sizes.items():
            expected[f"{algo}, {observation}"] = (kind, 256, size, 4, "highest", "ours")
        expected[f"{algo} for debug pieces"] = (kind, 128, 130, 4, "highest", "ours")
        if algo == "sac":
            for policy in ("DroQ", "SimBa", "mlp", "conv", "transformer"):
                expected[f"sac, {policy}"] = (SAC, 256, 1124, 4, "highest", "ours")
        expected[f"{algo}, roll, medium precision"] = (kind, 256, 1124, 4, "medium", "ours")
        expected[f"{algo}, roll, SB3 alone"] = (kind, 256, 1124, 4, "highest", "SB3's")
    return expected


@pytest.mark.slow
def test_all_parts_are_measured_in_their_order_printed_and_written(tmp_path, capsys, trained):
    assert main(["bench", "--rounds", "1", "--json", "result.json"]) == 0
    captured = capsys.readouterr()
    assert "RoboPianist-debug-CMajorScaleTwoHands-v0" in captured.out
    assert captured.out.endswith("Result: result.json\n")
    assert "simulation" in captured.err  # the progress bar
    stored = json.loads((tmp_path / "result.json").read_text())
    kinds = {"simulation": 10, "players": 5, "learner": 26, "training": 6, "memory": 2}
    assert [row["part"] for row in stored["rows"]] == [
        part for part, count in kinds.items() for _ in range(count)
    ]
    assert (stored["interrupted"], stored["peer"]) == (False, None)
    cells = [line.split("│") for line in captured.out.splitlines() if line.startswith("│")]
    medians = [(cell[1].strip(), float(cell[2])) for cell in cells if cell[2].strip()]
    assert [name for name, _ in medians] == [row["name"] for row in stored["rows"]]
    for (_, median), row in zip(medians, stored["rows"], strict=True):
        assert abs(median / row["value"] - 1) < 0.01
    updates, ratios = expected_updates(), {row["name"]: row["ratios"] for row in stored["rows"]}
    assert [row["name"] for row in stored["rows"] if row["part"] == "learner"] == list(updates)
    both = [*updates.values(), *reversed(updates.values())]  # to warm up, and backwards
    assert trained[: len(both)] == both
    assert [*ratios["sac, roll"]] == []
    assert [*ratios["sac, SimBa"]] == [*ratios["sac, hands"]] == ["x of sac, roll"]
    learnt = [name for a in CLASSES for name in (a, f"{a} for debug pieces")]
    assert [row["name"] for row in stored["rows"] if row["part"] == "training"] == learnt
    kinds = [CLASSES[name[:3]] for name in (*learnt, *reversed(learnt)) for _ in range(3)]
    assert [kind for kind, *_ in trained[len(both) :]] == kinds  # each step learns
    for name in learnt:
        parts = ("in the simulation", "in the learner", "elsewhere")
        shares = [ratios[name][f"of the time {part}"] for part in parts]
        assert min(shares) > 0
        assert sum(shares) == pytest.approx(1)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_prints_and_writes_what_there_is(monkeypatch, tmp_path, capsys):
    real, resets = PianoVectorEnv.reset, []

    def reset(venv, **kwargs):
        resets.append(venv)
        if len(resets) == 5:  # two in each round, the first of which warms up
            os.kill(os.getpid(), signal.SIGINT)
        return real(venv, **kwargs)

    monkeypatch.setattr(PianoVectorEnv, "reset", reset)
    assert main(["bench", "--only", "simulation", "--json", "result.json"]) == 130
    assert "Interrupted: what is missing was not measured." in capsys.readouterr().out
    stored = json.loads((tmp_path / "result.json").read_text())
    assert stored["interrupted"]
    assert [len(row["by_round"]) for row in stored["rows"]] == [1] * 10


def test_the_table_has_the_rows_with_their_ratios():
    rounds = {"by_round": (1, 2)}
    lines = shown(
        row("a", 1234.6, **rounds),
        row("b", 56.78, ratios={"x of a": 0.04567, "env/bare": 1.119}, **rounds),
        row("c", 9.16, "memory", "GB", ratios={"x of d": 12.34}),
        peer={"robopianist": "1.0.10"},
    )
    assert lines[:5] == tables["head"]
    assert rows_of("\n".join(lines)) == tables["rows"]


def test_the_table_has_processor_time_where_it_was_measured():
    timed = {"processor": 4.0, "processor_ratios": {"x of b": 0.5}}
    lines = shown(row("a", 1.5, ratios={"x of b": 0.375}, **timed), row("c", 9.16, "memory", "GB"))
    cells = rows_of("\n".join(lines))
    assert cells[1] == ["a", "1.50", "4.00", "0.375, 0.500 x of b"]
    assert cells[3] == ["c", "9.16", "", ""]


def test_the_machine_is_described_without_its_name_and_paths():
    machine = sb3_piano.lab.bench.machine_info()
    assert machine["versions"]["torch"] == importlib.metadata.version("torch")
    assert machine["versions"]["python"] == platform.python_version()
    assert {"sb3-piano", "mujoco", "numpy"} < set(machine["versions"])
    assert machine["cores"] >= 1
    assert machine["cpu"]
    assert socket.gethostname() not in str(machine)
    assert sys.prefix not in str(machine)
