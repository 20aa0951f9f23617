"""The demo: a piece planned, cloned and trained."""

import functools
import re
import runpy
import sys
from pathlib import Path

import pytest

DEMO = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "demo.py"))


@pytest.fixture
def demo(tmp_path, monkeypatch, capsys):
    """Return a function that runs the demo on a second of a piece, briefer, and what it printed."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    main = DEMO["main"]
    for name in ("EPISODES", "EPOCHS"):
        monkeypatch.setitem(main.__globals__, name, 4)
    settings = functools.partial(main.__globals__["load_fine_tuning"], learning_starts=100)
    monkeypatch.setitem(main.__globals__, "load_fine_tuning", settings)

    def run(steps):
        options = ["--seconds", "1", "--steps", str(steps), "--out", str(tmp_path / "out")]
        monkeypatch.setattr(sys, "argv", ["demo.py", "TwinkleTwinkle", *options])
        assert main() == 0
        return capsys.readouterr().out

    return run


def test_a_folder_with_the_runs_of_a_demo_is_refused_and_stays_as_it_is(demo, tmp_path, capsys):
    planned = tmp_path / "out" / "cloned"
    planned.mkdir(parents=True)
    (planned / "config.yml").write_text("algo: planned")
    (tmp_path / "out" / "piece.mid").write_text("that of the runs")
    with pytest.raises(SystemExit, match="2"):
        demo(steps=0)
    assert "has the runs of a demo already: expected another --out." in capsys.readouterr().err
    assert (tmp_path / "out" / "piece.mid").read_text() == "that of the runs"


@pytest.mark.slow
def test_it_judges_each_step_and_leaves_video_and_report(demo, tmp_path):
    scores = dict(re.findall(r"\| (\w+) +\| (\d\.\d+)", demo(steps=140)))
    assert list(scores) == ["resting", "planned", "cloned", "trained"]
    assert float(scores["planned"]) > float(scores["resting"])
    assert (tmp_path / "out" / "trained" / "play" / "performance.mp4").is_file()
    assert (tmp_path / "out" / "trained" / "evaluation" / "report.html").is_file()
