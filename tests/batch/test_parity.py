"""The suite that compares two physics: MuJoCo equals itself, and Warp is as near as its chaos."""

import argparse
import importlib.util
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "parity.py"


@pytest.fixture(scope="module")
def parity():
    spec = importlib.util.spec_from_file_location("parity", BENCHMARK)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def settings(**changes):
    usual = {"backend": "cpu", "device": None, "worlds": 3, "steps": 6, "seed": 0}
    return argparse.Namespace(**{**usual, **changes})


def test_the_exact_backend_differs_in_nothing(parity):
    steps, episodes = parity.compare("fast", settings())
    single = parity.single_steps(steps, "fast", settings())
    assert sum(int(row[1]) for row in single) >= 18
    assert all(row[2:] == ["0e+00"] * 3 + ["0 differ"] for row in single)
    own, beside, other = episodes
    assert own[1:] == other[1:]
    assert beside[3] != "0e+00"
    text = parity.table(("a", "b"), [["one", "two"]])
    assert text.splitlines() == ["| a | b |", "| --- | ---: |", "| one | two |"]


@pytest.mark.slow
def test_warp_is_no_further_from_mujoco_than_its_own_chaos(parity):
    pytest.importorskip("mujoco_warp")
    warp = settings(backend="warp", device="cpu", worlds=16, steps=24)
    steps, episodes = parity.compare("fast-capsules", warp)
    single = parity.single_steps(steps, "fast-capsules", warp)
    for kind, _, median, ninety, *_ in single:
        assert float(median) < 1e-4, kind
        assert float(ninety) < 1e-2, kind
    _, beside, other = (float(row[1]) for row in episodes)
    assert other > beside - 0.1
