"""Threads and precision of torch while something computes, and the former ones afterwards."""

import contextlib

import pytest
import torch
import yaml
from stable_baselines3.common.callbacks import BaseCallback
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.threads import torch_computing
from sb3_piano.training import RunConfig, evaluate, resume, train

VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")
FORMER = 3


@pytest.fixture(autouse=True)
def _former(monkeypatch):
    """Let the program around it have three threads, and no variable that says so."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    before = torch.get_num_threads()
    torch.set_num_threads(FORMER)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def high():
    """Let the program around it have chosen a precision that is not torch's own."""
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("high")
    yield
    torch.set_float32_matmul_precision(before)


class Noted(BaseCallback):
    """Notes the threads and the precision of every step."""

    def __init__(self):
        super().__init__()
        self.seen = set()

    def _on_step(self):
        self.seen.add((torch.get_num_threads(), torch.get_float32_matmul_precision()))
        return True


def pendulum(**changes):
    return RunConfig(**{**Tables(__file__)["pendulum"], **changes})


@pytest.mark.parametrize(
    ("variable", "wished", "threads"),
    [(None, None, 1), *((name, None, FORMER) for name in VARIABLES), (VARIABLES[0], 2, 2)],
)
def test_a_wish_counts_more_than_a_variable_until_an_error(monkeypatch, variable, wished, threads):
    if variable is not None:
        monkeypatch.setenv(variable, "3")
    with contextlib.suppress(RuntimeError), torch_computing(wished):
        assert torch.get_num_threads() == threads
        raise RuntimeError("broken")
    assert torch.get_num_threads() == FORMER


@pytest.mark.parametrize(
    ("wished", "expected"),
    [({}, (1, "high")), ({"num_threads": 2, "matmul_precision": "medium"}, (2, "medium"))],
)
def test_a_training_has_its_threads_and_precision_and_goes_on_with_them(
    tmp_path, high, wished, expected
):
    noted = Noted()
    run = train(pendulum(**wished), tmp_path / "run", callbacks=[noted], progress_bar=False).folder
    assert noted.seen == {expected}
    provenance = yaml.safe_load(run.provenance_file.read_text())
    assert (provenance["torch_threads"], provenance["matmul_precision"]) == expected
    assert run.read_config().num_threads == wished.get("num_threads")
    noted.seen.clear()
    resume(run.path, 30, callbacks=[noted], progress_bar=False)
    assert noted.seen == {expected}
    assert (torch.get_num_threads(), torch.get_float32_matmul_precision()) == (FORMER, "high")


def test_what_plays_has_its_threads_and_another_precision_is_refused(tmp_path, monkeypatch):
    run = train(pendulum(num_threads=2), tmp_path / "run", progress_bar=False).folder
    seen, forward = set(), torch.nn.Linear.forward

    def noted(layer, inputs):
        seen.add(torch.get_num_threads())
        return forward(layer, inputs)

    monkeypatch.setattr(torch.nn.Linear, "forward", noted)
    evaluate(run.path)
    assert seen == {1}
    with pytest.raises(ConfigError, match="matmul_precision.*'low'.*medium"):
        pendulum(matmul_precision="low")
