"""A take comes back from its file with all that was played, and goes wherever a player goes."""

import dataclasses
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import sb3_piano
from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.take import Take
from sb3_piano.training import OpenPlayer

TUNE = Score(notes=[Note(onset=i / 4, offset=(i + 1) / 4, pitch=72 + i) for i in range(3)])


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_midi(TUNE, "tune.mid")


@pytest.fixture(scope="module")
def take(tmp_path_factory):
    file = tmp_path_factory.mktemp("score") / "tune.mid"
    write_midi(TUNE, file)
    with OpenPlayer.open("sight-reader", score=file, physics="fast", seed=3) as player:
        return player.play()[0]


def test_a_take_comes_back_from_its_file(take):
    take.write("take.npz")
    found = Take.read("take.npz")
    assert (found.title, found.player, found.seed) == ("tune", "sight-reader", 3)
    assert found.metrics == pytest.approx(take.metrics, nan_ok=True, abs=0)
    assert found.env["options"]["physics"] == "fast"
    assert found.versions["mujoco"]
    assert found.scene.options == take.scene.options
    assert found.score == take.score
    for mine, its in ((take.motion, found.motion), (take.piano, found.piano)):
        for field in dataclasses.fields(mine):
            value, other = getattr(mine, field.name), getattr(its, field.name)
            if isinstance(value, np.ndarray):
                assert np.array_equal(value, other, equal_nan=value.dtype.kind == "f"), field.name
                assert value.dtype == other.dtype
    assert found.piano.roll.equals(take.piano.roll)
    assert found.piano.score == take.piano.score
    assert found.musicianship() == pytest.approx(take.musicianship(), nan_ok=True, abs=0)
    assert found.piano.metrics() == pytest.approx(take.piano.metrics(), nan_ok=True, abs=0)


def test_a_damaged_take_is_refused_and_one_of_no_piano_is_not_written(take):
    for name, change, message in (
        ("qpos", lambda rows: rows[1:], "a row more"),
        ("qpos", lambda rows: np.hstack([rows, rows]), r"its scene has \d+ joints"),
        ("performance_sustain", lambda steps: steps[1:], "sustain has shape"),
        ("performance_strike_time", lambda times: times[1:], "strike_time has shape"),
        ("roll_active", lambda keys: keys[1:], "Array 'finger' has shape"),
        ("header", lambda text: text[1:], "is no take"),
    ):
        take.write("take.npz")
        arrays = dict(np.load("take.npz"))
        np.savez("take.npz", **(arrays | {name: change(arrays[name])}))
        with pytest.raises(ConfigError, match=message):
            Take.read("take.npz")
    with pytest.raises(RunError, match="is of no piano"):
        Take(metrics={"return": 1.0}).write("take.npz")


def test_commands_take_a_take_in_place_of_a_player(capsys):
    play = ["play", "tune.mid", "--physics", "fast", "--no-video", "--no-progress"]
    assert main(play) == 0
    file = "play/tune-sight-reader/performance.npz"
    told = capsys.readouterr().out
    assert f"Take:  {file}" in told
    assert "replaced" not in told
    assert main(["play", file, "--no-video", "--no-progress", "--out", "again"]) == 0
    assert read_midi("again/performance.mid") == read_midi("play/tune-sight-reader/performance.mid")
    assert main(["play", file, "--no-video", "--no-progress", "--out", "again"]) == 0
    assert "Note:  the former files in 'again' are replaced" in capsys.readouterr().out
    assert main(["report", file, "--out", "report.html"]) == 0
    assert main(["compare", file, "again/performance.npz", "--metric", "f1"]) == 0
    assert "tune" in capsys.readouterr().out
    assert main(["play", file, "--player", "planned"]) == 2
    assert "--player cannot be given with the take" in capsys.readouterr().err


def test_a_midi_file_walks_through_nine_rooms_to_what_is_heard(capsys):
    package = Path(sb3_piano.__file__).parent
    rooms = set()

    def note(frame, event, argument):
        file = Path(frame.f_code.co_filename)
        if event == "call" and file.is_relative_to(package):
            first, *rest = file.relative_to(package).parts
            rooms.update([first] if rest and frame.f_code.co_name[0] != "<" else [])

    play = ["play", "tune.mid", "--player", "sight-reader", "--physics", "fast", "--no-video"]
    assert main([*play, "--no-progress"]) == 0  # what is only imported is no part of the walk
    sys.setprofile(note)
    try:
        main([*play, "--no-progress", "--out", "again"])
    finally:
        sys.setprofile(None)
    assert rooms == {
        *("cli", "training", "players", "music", "envs"),
        *("hands", "simulation", "reading", "metrics"),
    }


def test_one_line_of_python_plays_a_file():
    take = sb3_piano.play("tune.mid", physics="fast")
    assert (take.player, take.title) == ("sight-reader", "tune")
    assert (take.f1, take.onset_f1) == (take.metrics["f1"], take.metrics["onset_f1"])
    take.save_midi("take.mid")
    told = [
        dataclasses.replace(note, finger=-1, hand=None) for note in take.score.notes
    ]  # in one track
    assert list(read_midi("take.mid").notes) == told
    take.save_wav("take.wav")
    take.save_report("take.html")
    assert "sight-reader" in Path("take.html").read_text(encoding="utf-8")
    assert f"F1 {take.f1:.3f}" in take._repr_html_()
    assert "data:audio/mpeg;base64," in take._repr_html_()
    assert dir(sb3_piano) == sorted(sb3_piano.__all__)
    silent = dataclasses.replace(take, performance=None)
    with pytest.raises(RunError, match="No key was pressed"):
        silent.save_midi("none.mid")


@pytest.mark.slow
def test_a_plan_is_refined_played_and_reported_by_one_command(capsys):
    play = ["play", "tune.mid", "--refine", "0.001", "--report", "--no-video", "--physics", "fast"]
    assert main([*play, "--no-progress"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"Plan:  play/tune-planned/plan.npz \(F1 [\d.]+ before, [\d.]+ refined", out)
    assert Path("play/tune-planned-plan/report.html").is_file()
    assert Path("play/tune-planned-plan/performance.mid").is_file()
    assert main([*play, "--player", "sight-reader"]) == 2
    assert "--player cannot be given with --refine: the plan plays" in capsys.readouterr().err
