"""What large experiments take is computed from named costs, and the page shows what comes out."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module")
def scale():
    spec = importlib.util.spec_from_file_location("scale", DOCS / "building" / "scale.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_table_of_the_page_is_what_the_script_computes(scale):
    assert f"\n{scale.table()}\n" in (DOCS / "at_scale.md").read_text(encoding="utf-8")


def test_jobs_run_in_waves_and_what_comes_after_has_no_more_cores_than_it_can_use(scale):
    experiment = scale.Experiment("five", jobs=5, job=10.0, after=60.0, after_cores=2)
    assert experiment.seconds(machines=1, cores=2) == 3 * 10 + 30
    assert experiment.seconds(machines=2, cores=2) == 2 * 10 + 30
    assert experiment.seconds(machines=100, cores=16) == 10 + 30


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(90, "2 min"), (2 * 3600, "2.0 h"), (40 * 3600, "40 h"), (50 * 3600, "2.1 days")],
)
def test_times_are_in_a_unit_that_suits_them(scale, seconds, words):
    assert scale.in_words(seconds) == words
