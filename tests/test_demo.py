"""The demo: a piece planned, cloned and trained."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

DEMO = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "demo.py"))


@pytest.fixture
def demo(tmp_path, monkeypatch):
    """Return the demo's steps, briefer."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    demo = DEMO["demo"]
    for name in ("EPISODES", "EPOCHS"):
        monkeypatch.setitem(demo.__globals__, name, 4)
    return demo


@pytest.mark.slow
def test_without_steps_of_sac_it_ends_with_the_clone(demo, tmp_path):
    *_, last = demo("TwinkleTwinkle", 1.0, tmp_path / "out", 0, 0)
    assert last.startswith("| cloned ")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "piece.mid",
        "planned",
        "cloned",
    }


@pytest.mark.slow
def test_it_judges_each_step_and_leaves_video_and_report(demo, tmp_path):
    rows = "\n".join(demo("TwinkleTwinkle", 1.0, tmp_path / "out", 0, 2480))
    scores = dict(re.findall(r"\| (\w+) +\| (\d\.\d+)", rows))
    assert list(scores) == ["resting", "planned", "cloned", "trained"]
    assert float(scores["planned"]) > float(scores["resting"])
    assert (tmp_path / "out" / "trained" / "play" / "performance.mp4").is_file()
    assert (tmp_path / "out" / "trained" / "evaluation" / "report.html").is_file()
