"""A whole benchmark, as short as can be; what was found is what is shown."""

from __future__ import annotations

import json
import platform
import socket
import sys

import pytest
import torch
from rich.console import Console

from sb3_piano.bench import PARTS, PeerError, Report, Row, render, run_bench
from sb3_piano.bench.machine import Machine, cpu_model, this_machine
from sb3_piano.bench.table import rounded


def text_of(report):
    console = Console(width=80)
    with console.capture() as capture:
        console.print(render(report))
    return capture.get()


def cells_of(line):
    return [cell.strip() for cell in line.strip("│").split("│")]


@pytest.fixture
def machine():
    return Machine(
        date="2030-01-02 03:04+00:00",
        versions={"python": "3.11.7", "mujoco": "3.17.0"},
        cpu="Slow 486",
        cores=3,
        torch_threads=2,
        device="cpu",
    )


@pytest.mark.slow
def test_all_parts_are_measured_in_their_order(short):
    told = []
    report = run_bench(short(rounds=2), lambda *lap: told.append(lap))
    parts = [row.part for row in report.rows]
    kinds = {"simulation": 10, "learner": 12, "training": 6, "memory": 2}
    assert parts == [part for part, count in kinds.items() for _ in range(count)]
    assert told[-1] == ("training", 18, 18)
    assert all(row.value > 0 for row in report.rows)
    assert {len(row.by_round) for row in report.rows if row.part != "memory"} == {2}
    assert (report.interrupted, report.peer) == (False, None)
    shown = text_of(report)
    for row in report.rows:
        assert f"│ {row.name} " in shown
    assert json.loads(json.dumps(report.to_json()))["rows"][3]["name"] == report.rows[3].name


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_a_part_can_be_measured_alone(part, short):
    found = {row.part for row in run_bench(short(parts=(part,))).rows}
    assert found == ({"learner", "training"} if part == "learner" else {part})


def test_torch_has_the_threads_only_meanwhile(short):
    former, during = torch.get_num_threads(), []
    report = run_bench(
        short(parts=("simulation",), num_threads=former + 1),
        lambda *_: during.append(torch.get_num_threads()),
    )
    assert set(during) == {former + 1}
    assert report.machine.torch_threads == former + 1
    assert torch.get_num_threads() == former


@pytest.mark.slow
def test_ctrl_c_keeps_what_was_measured(short):
    def stop(part, done, laps):
        if part == "learner":
            raise KeyboardInterrupt

    report = run_bench(short(), stop)
    assert report.interrupted
    assert [row.part for row in report.rows] == ["simulation"] * 10
    assert "Interrupted: what is missing was not measured." in text_of(report)


def test_a_peer_that_is_not_there_is_told_before_anything_is_measured(short):
    told = []
    settings = short(peer_python=sys.executable)
    with pytest.raises(PeerError, match="cannot run RoboPianist"):
        run_bench(settings, lambda *lap: told.append(lap))
    assert told == []


def test_the_table_is_the_json(machine):
    rows = (
        Row(part="simulation", name="a", value=1234.6, unit="steps/s", ratios={}, by_round=(1, 2)),
        Row(part="simulation", name="b", value=56.78, unit="steps/s",
            ratios={"x of a": 0.04567, "env/bare": 1.119}, by_round=(1, 2)),
        Row(part="memory", name="c", value=9.16, unit="GB", ratios={"x of d": 12.34}),
    )  # fmt: skip
    report = Report(machine=machine, peer={"robopianist": "1.0.10"}, rows=rows, interrupted=False)
    shown = text_of(report).splitlines()
    assert shown[:5] == [
        "RoboPianist-debug-CMajorScaleTwoHands-v0, 2030-01-02 03:04+00:00",
        "python 3.11.7, mujoco 3.17.0",
        "Slow 486, usable cores: 3; networks on cpu, torch threads: 2",
        "The peer: robopianist 1.0.10",
        "Rounds: 2. env/bare: time of the env over that of its mj_step.",
    ]
    assert [cells_of(line) for line in shown if line.startswith("│")] == [
        ["Simulation, steps/s", "", ""],
        ["a", "1235", ""],
        ["b", "56.8", "0.046 x of a"],
        ["", "", "1.12 env/bare"],
        ["Full replay buffer, GB", "", ""],
        ["c", "9.16", "12.3 x of d"],
    ]
    stored = json.loads(json.dumps(report.to_json()))
    assert stored["rows"][1] == {
        "part": "simulation", "name": "b", "value": 56.78, "unit": "steps/s",
        "ratios": {"x of a": 0.04567, "env/bare": 1.119}, "by_round": [1, 2],
    }  # fmt: skip
    assert stored["machine"]["cpu"] == "Slow 486"
    assert (stored["peer"], stored["interrupted"]) == ({"robopianist": "1.0.10"}, False)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0456, "0.046"), (0.951, "0.951"), (1.0, "1.00"), (9.994, "9.99"), (12.34, "12.3"),
     (99.94, "99.9"), (100.4, "100"), (2345.6, "2346")],
)  # fmt: skip
def test_numbers_are_shown_with_three_digits(value, text):
    assert rounded(value) == text


def test_nothing_measured_is_shown_too(machine):
    report = Report(machine=machine, peer=None, rows=(), interrupted=True)
    assert "Rounds: 0." in text_of(report)
    assert "The peer" not in text_of(report)


def test_the_processor_is_named(tmp_path):
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text("processor\t: 0\nmodel name\t: A: fast one\n\nmodel name\t: B\n")
    assert cpu_model(cpuinfo) == "A: fast one"
    cpuinfo.write_text("processor\t: 0\n")
    assert cpu_model(cpuinfo) == (platform.processor() or platform.machine())
    assert cpu_model(tmp_path / "none") == (platform.processor() or platform.machine())


def test_the_machine_is_described_without_its_name_and_paths():
    machine = this_machine()
    assert machine.versions["torch"] == torch.__version__
    assert machine.versions["python"] == platform.python_version()
    assert {"sb3-piano", "mujoco", "numpy"} < set(machine.versions)
    assert machine.cores >= 1
    assert machine.device == ("cpu" if not torch.cuda.is_available() else machine.device)
    assert socket.gethostname() not in str(machine)
    assert sys.prefix not in str(machine)
