"""The report of a run: what its model plays, its training's log, where it comes from."""

import webbrowser

import numpy as np
import pytest
from acting import LOUD, scalars
from html_page import Page
from torch.utils.tensorboard import SummaryWriter
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.training import RunFolder, evaluate, write_report
from sb3_piano.training.evaluation.report import training_curves
from sb3_piano.viewing.report.page import definition_of, formatted


def text_of(path):
    return Page(path.read_text(encoding="utf-8")).text


@pytest.mark.slow
def test_it_shows_what_an_evaluation_from_the_same_seed_measures(piano_run):
    run = piano_run(LOUD, physics="fast")
    evaluation = evaluate(run.path, seed=3)
    path = write_report(run.path, seed=3)
    assert path == run.evaluation_dir / "report.html"
    text = text_of(path)
    assert "TD3 after 1 steps of training · fast physics · seed 3 duet" in text
    for name in ("f1", "onset_f1", "wrong_presses_per_second", "return", "return_energy", "length"):
        numbers = (formatted(name, of[name]) for of in (evaluation.mean, evaluation.baseline))
        assert " ".join([definition_of(name).label, *numbers]).replace("\xa0", " ") in text, name
    assert {file.name for file in run.evaluation_dir.iterdir()} == {
        *("metrics.json", "performance_1.mid", "report.html")
    }


@pytest.mark.slow
def test_it_says_where_run_and_report_come_from_and_how_to_make_it_again(piano_run, tmp_path):
    run = piano_run(LOUD)
    text = text_of(write_report(run.path, tmp_path / "fast.html", seed=2, physics="fast"))
    for fact in Tables(__file__)["facts"]:
        assert fact.format(run=run.path) in text
    assert "Training unknown" not in text
    assert "--physics" not in text_of(write_report(run.path))
    run.provenance_file.write_text("no: [yaml")
    damaged = text_of(write_report(run.path))
    for fact in ("(of the training: unknown)", "Trained with unknown", "Training unknown"):
        assert fact in damaged


@pytest.mark.slow
def test_curves_are_what_the_training_logged(pendulum_run, piano_run):
    folder = pendulum_run(n_timesteps=100)
    curves = training_curves(folder)
    assert {"rollout/ep_rew_mean", "train/critic_loss"} <= set(curves)
    for name, curve in curves.items():
        logged = scalars(folder, name)
        assert list(curve.steps) == sorted(logged), name
        assert list(curve.values) == [logged[step] for step in curve.steps], name
    piano = piano_run(LOUD, "piano", physics="fast")
    for leftover in piano.tensorboard_dir.rglob("*"):
        if leftover.is_file():
            leftover.unlink()
    assert "There is no log of the training" in text_of(write_report(piano.path))
    with SummaryWriter(str(piano.tensorboard_dir / "run_1")) as log:
        log.add_scalar("music/f1", 0.25, 100)
    page = write_report(piano.path)
    assert "There is no log of the training" not in text_of(page)
    assert 'id="training-1"' in page.read_text()


def test_of_a_training_that_was_taken_up_again_only_what_counts_is_kept(tmp_path):
    def log(name, points, start):
        with SummaryWriter(str(tmp_path / "tensorboard" / name)) as writer:
            for i, (step, value) in enumerate(points):
                writer.add_scalar("music/f1", value, step, walltime=start + i)

    log("run_2", [(20, 0.5), (30, 0.6), (40, 0.7)], start=200.0)
    log("run_1", [(10, 0.1), (20, 0.2), (30, np.nan), (45, 0.4)], start=100.0)
    log("run_10", [(40, 0.8), (50, np.inf), (60, 0.9)], start=300.0)
    (tmp_path / "tensorboard" / "empty").mkdir()
    (curve,) = training_curves(RunFolder(tmp_path)).values()
    assert curve.steps.tolist() == [10, 20, 30, 40, 60]
    assert curve.values == pytest.approx([0.1, 0.5, 0.6, 0.8, 0.9])


@pytest.mark.slow
def test_a_long_log_is_read_whole_and_a_torn_one_as_far_as_it_goes(tmp_path):
    with SummaryWriter(str(tmp_path / "tensorboard" / "run_1")) as writer:
        for step in range(12_000):  # TensorBoard itself reads 10,000
            writer.add_scalar("music/f1", step / 12_000, step)
    (curve,) = training_curves(RunFolder(tmp_path)).values()
    assert curve.steps.tolist() == list(range(12_000))
    (file,) = (tmp_path / "tensorboard" / "run_1").iterdir()
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    (torn,) = training_curves(RunFolder(tmp_path)).values()
    assert 5_000 < len(torn.steps) < 7_000


@pytest.mark.slow
def test_what_cannot_be_shown_is_refused(pendulum_run, piano_run, tmp_path):
    with pytest.raises(RunError, match="its environment 'Pendulum-v1' is no piano"):
        write_report(pendulum_run("other").path)
    run = piano_run(LOUD)
    with pytest.raises(RunError, match="x.html' cannot be written: No such file or directory"):
        write_report(run.path, tmp_path / "no" / "x.html")
    for wrong, message in (({"seed": -1}, "seed is -1"), ({"physics": "quick"}, "Unknown physics")):
        with pytest.raises(ConfigError, match=message):
            write_report(run.path, **wrong)
    assert not (run.evaluation_dir / "report.html").exists()


def test_the_report_of_a_piece_is_its_piano_roll(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["report", "TwinkleTwinkleLittleStar"]) == 0
    (page,) = tmp_path.glob("play/*/piano_roll.html")
    assert capsys.readouterr().out == f"Report: {page.relative_to(tmp_path)}\n"
    assert "notes in" in text_of(page)


@pytest.mark.parametrize("starts", [True, False])
def test_the_report_is_opened_in_the_browser_of_the_machine(tmp_path, starts, monkeypatch, capsys):
    browser, seen, page = (tmp_path / name for name in ("browser", "seen", "page.html"))
    browser.write_text(f'#!/bin/sh\necho "$1" > "{seen}"\n' if starts else "#!/bin/sh\nexit 1\n")
    browser.chmod(0o755)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    monkeypatch.setenv("PATH", "")  # no other browser is found
    monkeypatch.setattr(webbrowser, "_tryorder", None)  # look again
    monkeypatch.setattr(webbrowser, "_browsers", {})
    assert main(["report", "FurElise", "--out", str(page), "--open"]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith(f"Report: {page}\n")
    assert ("No web browser could be started" in captured.err) is not starts
    assert "Onset density" in text_of(page)
    if starts:
        assert seen.read_text().strip() == page.as_uri()
