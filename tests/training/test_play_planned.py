"""``sb3-piano play --planned``: a MIDI file in, a performance out, no training."""

from __future__ import annotations

import re
from pathlib import Path

import av
import numpy as np
import pretty_midi
import pytest

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score, read_midi, write_midi
from sb3_piano.simulation import find_gl_backend
from sb3_piano.training.playing.takes import planner_config, take_of_planner, where_played

needs_gl = pytest.mark.skipif(find_gl_backend() is None, reason="no OpenGL library on this machine")

# Without fingers.
TUNE = Score(
    notes=[
        Note(onset=0.0, offset=0.4, pitch=76),
        Note(onset=0.0, offset=0.4, pitch=48),
        Note(onset=0.45, offset=0.8, pitch=77),
    ],
    title="tune",
)
TOO_WIDE = Score(
    notes=[
        Note(onset=0.0, offset=0.2, pitch=60, finger=0),
        Note(onset=0.0, offset=0.2, pitch=84, finger=4),
    ]
)
ZERO = ["--sampling", "2", "--nominal", "none", "--horizon", "2"]
"""Sampling from zero, which needs no plan and little time."""


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_midi(TUNE, "tune.mid")


@pytest.mark.slow
@needs_gl
def test_a_midi_file_becomes_a_video_with_sound(capsys):
    command = ["play", "--planned", "tune.mid", "--physics", "fast", "--size", "64x48"]
    assert main(command) == 0
    out, error = capsys.readouterr()
    f1, precision, recall, nothing, onset_f1 = map(float, re.findall(r"\d\.\d{3}", out))
    assert f1 > 0.8 > nothing
    assert precision + recall > 1.6
    assert 0 <= onset_f1 <= 1
    assert re.search(r"Planned in \d+\.\d s, 1\.4 s of music played in \d+\.\d s", out)
    folder = Path("play/tune-planned")
    assert f"Video: {folder / 'performance.mp4'}" in out
    played = read_midi(folder / "performance.mid")
    assert {note.pitch for note in played.notes} == {48, 76, 77}
    with av.open(str(folder / "performance.mp4")) as video:
        assert (len(video.streams.video), len(video.streams.audio)) == (1, 1)
    assert error.strip() == ""


@pytest.mark.slow
def test_what_cannot_be_played_is_told_in_words(capsys):
    write_midi(TOO_WIDE, "wide.mid")
    command = ["play", "wide.mid", "--planned", "--no-video", "--physics", "fast"]
    assert main([*command, "--out", "here", "--no-progress"]) == 0
    out, error = capsys.readouterr()
    assert error.startswith("sb3-piano: warning: 1 note cannot be played as written")
    told = "C4 (pitch 60) at 0.50 s, right thumb: left out by the hand, which plays C6"
    assert error.count(told) == 1
    assert "Sound: here/performance.wav" in out


@pytest.mark.slow
def test_what_is_left_out_of_a_file_is_told_in_words(capsys):
    music = pretty_midi.PrettyMIDI()
    music.instruments.append(pretty_midi.Instrument(program=0))
    for pitch in (60, 120):  # the piano ends at 108
        music.instruments[0].notes.append(pretty_midi.Note(80, pitch, 0.0, 0.5))
    music.write("high.mid")
    command = ["play", "high.mid", "--planned", "--no-video", "--physics", "fast"]
    assert main([*command, "--no-progress"]) == 0
    error = capsys.readouterr().err
    told = "sb3-piano: warning: Reading 'high.mid' left out 1 note off the keyboard (C9 at 0 s)."
    assert error.strip() == told


def test_sampling_has_a_folder_of_its_own(capsys):
    command = ["play", "--planned", "tune.mid", "--no-video", "--physics", "fast", *ZERO]
    assert main(command) == 0
    assert "Sound: play/tune-sampling/performance.wav" in capsys.readouterr().out


def test_all_joints_play_unless_the_reduced_action_space_is_asked_for(monkeypatch):
    widths = []

    def noted(config, on_step):
        played = take_of_planner(config, on_step)
        widths.append(played.take.scene.model.nu)
        return played

    monkeypatch.setattr("sb3_piano.training.playing.takes.take_of_planner", noted)
    command = ["play", "--planned", "tune.mid", "--no-video", "--physics", "fast", *ZERO]
    assert main(command) == main([*command, "--reduced"]) == 0
    assert widths == [44, 38]


def test_the_listener_hears_of_planning_and_of_every_step():
    calls = []
    arguments = {"samples": 1, "horizon": 1, "nominal": "none"}
    config = planner_config("tune.mid", "sampling", env_kwargs={"physics": "fast"}, **arguments)
    played = take_of_planner(config, lambda done, total: calls.append((done, total)))
    steps = len(played.take.performance.roll)
    assert calls == [(step, steps) for step in range(steps + 1)]
    assert played.metrics["length"] == steps
    # Half a second to get to the first note, and a finger for each note.
    roll = played.take.performance.roll
    assert not roll.active[:10].any()
    assert roll.active[10].sum() == 2
    assert (roll.finger[roll.active] >= 0).all()
    assert len(played.take.qpos) == steps + 1
    assert played.score.title == "tune"
    assert min(played.planning, played.playing) > 0


@pytest.mark.slow
def test_equal_seeds_of_sampling_play_alike():
    def played(seed):
        arguments = {"samples": 3, "horizon": 2, "nominal": "none", "n_threads": 1}
        config = planner_config(
            "tune.mid", "sampling", seed=seed, env_kwargs={"physics": "fast"}, **arguments
        )
        return take_of_planner(config).take.qpos

    np.testing.assert_array_equal(played(1), played(1))
    assert not np.array_equal(played(1), played(2))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--sampling", "4"], "--sampling cannot be given without --planned"),
        (["--nominal", "none"], "--nominal cannot be given without --planned"),
        (["--horizon", "4"], "--horizon cannot be given without --planned"),
        (["--reduced"], "--reduced cannot be given without --planned"),
        (["--planned", "--horizon", "4"], "--horizon cannot be given without --sampling"),
        (["--planned", "--score", "FurElise"], "--score cannot be given with a piece"),
        (["--planned", "--best", "f1"], "--best cannot be given with a piece"),
        (["--planned", "--physics", "slow"], "Unknown physics profile 'slow'"),
    ],
)
def test_what_does_not_go_together_is_told(arguments, message, capsys):
    assert main(["play", "tune.mid", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not Path("play").exists()


def test_a_run_is_not_played_by_a_planner(capsys):
    Path("run").mkdir()
    assert main(["play", "run", "--planned"]) == 2
    assert "--planned cannot be given with the run 'run'" in capsys.readouterr().err


def test_a_piece_without_planned_still_plays_itself(capsys):
    assert main(["play", "tune.mid", "--no-video"]) == 0
    assert "Sound: play/tune/performance.wav" in capsys.readouterr().out
    assert read_midi("play/tune/performance.mid").notes == read_midi("tune.mid").notes


def test_environments_files_and_names_are_told_apart():
    assert where_played("RoboPianist-hanon-01-v0") == ("RoboPianist-hanon-01-v0", {})
    assert where_played("tune.mid") == ("RoboPianist-v0", {"score": "tune.mid"})
    assert where_played("FurElise") == ("RoboPianist-v0", {"score": "FurElise"})
    with pytest.raises(ConfigError, match="There is no 'x/y'"):
        where_played("x/y")
