"""Computations side by side: in turns, in two processes, and hands as the latter plan them."""

import multiprocessing
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.planning import PlanSettings, hand_plan, plan
from sb3_piano.planning.plan import HandTasks
from sb3_piano.planning.side_by_side import in_two_processes, run_interleaved
from sb3_piano.simulation import compile_scene
from sb3_piano.threads import usable_cores


def growing(number):
    """Add what all have, weighted by place, three times."""
    for _ in range(3):
        told = yield number
        number += sum((place + 1) * one for place, one in enumerate(told))
    return number, os.getpid()


def killed_elsewhere(number):
    """Do the same, unless it is in a process that another one started."""
    if multiprocessing.parent_process() is not None:
        os.kill(os.getpid(), signal.SIGKILL)
    return (yield from growing(number))


def failing(number):
    yield number
    raise ValueError(f"{number} is not good.")


def test_each_is_told_what_all_have_in_their_order():
    assert [number for number, _ in run_interleaved(growing, (1, 10))] == [442, 451]


@pytest.mark.slow
def test_if_the_other_process_is_killed_all_is_done_in_this_one():
    (one, here), (other, there) = in_two_processes(killed_elsewhere, 1, 10)
    assert (one, other) == (442, 451)
    assert here == there == os.getpid()


@pytest.mark.slow
def test_an_error_comes_out():
    with pytest.raises(ValueError, match="1 is not good"):
        in_two_processes(failing, 1, 10)


@pytest.mark.slow
def test_hands_planned_in_two_processes_are_the_same_to_the_last_bit(monkeypatch):
    """The hands come near to each other, so that the line between them moves."""
    notes = (
        (0.4 * i, 0.4 * i + 0.3, 60 + shift + i % 3, hand)
        for i in range(12)
        for shift, hand in ((0, "left"), (3, "right"))
    )
    score, scene = score_of(*notes), compile_scene()
    settings = PlanSettings(window=1.0, overlap=0.5)
    calls = []
    monkeypatch.setattr(hand_plan, "may_start_processes", lambda: False)
    here = plan(score, scene, settings)

    def in_two(*arguments):
        calls.append(arguments)
        return in_two_processes(*arguments)

    monkeypatch.setattr(hand_plan, "may_start_processes", lambda: True)
    monkeypatch.setattr(hand_plan, "in_two_processes", in_two)
    apart = plan(score, scene, settings)
    assert len(calls) == 1
    assert np.abs(here.arm_line - HandTasks.of(here.roll, scene, settings).line).max() > 0.001
    for name in ("positions", "commands", "arm_line"):
        np.testing.assert_array_equal(getattr(apart, name), getattr(here, name))
    for one, other in zip(apart.hands, here.hands, strict=True):
        np.testing.assert_array_equal(one.gains, other.gains)
    assert apart.problems == here.problems


@pytest.mark.slow
@pytest.mark.parametrize(("how", "may"), [(["{}.py"], False), (["-m", "{}"], usable_cores() > 1)])
def test_a_script_starts_no_processes_as_it_may_have_no_guard(tmp_path, how, may):
    code = "from sb3_piano.planning.side_by_side import may_start_processes as may\nprint(may())\n"
    (tmp_path / "asking.py").write_text(code)
    command = [sys.executable, *(part.format("asking") for part in how)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(may)]
