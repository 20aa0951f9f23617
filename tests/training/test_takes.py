"""What a run or a piece plays comes out as MIDI, sound and video that agree."""

import re

import av
import numpy as np
import pytest
from acting import LOUD
from hearing import onsets_in
from scipy.io import wavfile
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import Note, Pedal, Score, write_midi
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.training import OpenPlayer, play_run
from sb3_piano.training.playing.takes import play_score, take_of, take_of_score
from sb3_piano.viewing import Picture

tables = Tables(__file__)

needs_gl = pytest.mark.skipif(find_gl_backend() is None, reason="no OpenGL library on this machine")

SMALL = Picture(width=64, height=48)
SCORE = ["play", "--player", "score"]
FILES = ["performance.mid", "performance.mp4", "performance.wav"]
SILENT = ["performance.npz", "performance.wav"]

PIECE = Score(
    notes=[
        Note(onset=0.12, offset=0.22, pitch=48, finger=9, velocity=100),
        Note(onset=0.5, offset=0.58, pitch=60, finger=0, velocity=60),
        Note(onset=0.913, offset=1.1, pitch=72),
    ],
    pedals=[Pedal(onset=1.3, offset=1.4)],
    title="three notes",
)


def episode_of(run, **options):
    with OpenPlayer.open(run, **options) as player:
        return take_of(player)


def rest_action(score):
    return PianoEnv(score).rest_action


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def video_of(path):
    """Return number, width, height and rate of the pictures, and the sound with its rate."""
    with av.open(str(path)) as container:
        stream, audio = container.streams.video[0], container.streams.audio[0]
        count = sum(1 for _ in container.decode(stream))
        container.seek(0)
        sound = np.concatenate([frame.to_ndarray() for frame in container.decode(audio)], axis=1)
        size = stream.codec_context.width, stream.codec_context.height
        return count, size, stream.average_rate, sound.T, audio.rate


@pytest.mark.slow
@needs_gl
def test_a_piece_plays_itself_and_the_videos_sound_begins_its_notes_when_the_midi_file_does(
    tmp_path,
):
    told = []
    played = play_score(
        PIECE, tmp_path, picture=SMALL, progress=lambda done, total: told.append((done, total))
    )
    assert told == [(k, 72) for k in range(73)]
    assert names_in(tmp_path) == FILES
    assert (played.midi, played.wav, played.video) == tuple(
        tmp_path / name for name in ("performance.mid", "performance.wav", "performance.mp4")
    )
    assert played.problem is None
    onsets = [note.onset for note in read_midi(played.midi).notes]
    assert onsets == pytest.approx([0.12, 0.5, 0.913], abs=1e-4)
    count, size, rate, sound, sample_rate = video_of(played.video)
    # 1.1 s are 22 steps and a silent one; as much as a step is seen before the first
    assert (count, size, rate) == (72, (64, 48), 60)
    assert len(sound) / sample_rate == pytest.approx(72 / 60, abs=0.025)
    np.testing.assert_allclose(onsets_in(sound, sample_rate), onsets, atol=0.05)


def test_keys_go_down_when_they_are_due_while_the_hands_rest_and_the_last_note_rings(tmp_path):
    take = take_of_score(PIECE)
    scene, roll = take.scene, take.piano.roll
    hands = np.setdiff1d(np.arange(scene.model.nq), scene.key_qpos)
    np.testing.assert_array_equal(
        take.qpos[:, hands], np.tile(scene.model.qpos0[hands], (len(roll) + 1, 1))
    )
    down = take.qpos[:, scene.key_qpos] >= scene.key_max_angle
    assert not down[0].any()
    np.testing.assert_array_equal(down[1:], roll.active)
    assert down[3:6, 48 - 21].tolist() == [True, True, True]  # steps 2 to 4
    assert take.piano.metrics()["f1"] == 1.0
    assert take.piano.metrics()["onset_f1"] == 1.0
    assert take_of_score(PIECE, physics="fast").scene.model.opt.timestep == 0.01
    rate, samples = wavfile.read(play_score(PIECE, tmp_path, picture=None).wav)
    assert len(samples) / rate == pytest.approx(1.1 + 1.0, abs=1e-3)
    np.testing.assert_allclose(onsets_in(samples, rate), [0.12, 0.5, 0.913], atol=0.003)


@pytest.mark.slow
@needs_gl
def test_a_key_that_goes_down_by_itself_keeps_its_fingers_colour(tmp_path):
    piece = Score(notes=[Note(onset=0.0, offset=0.2, pitch=48, finger=0)])
    played = play_score(piece, tmp_path, picture=Picture(width=320, height=240))
    with av.open(str(played.video)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    picture = frames[3].astype(int)
    red, green, blue = picture[..., 0], picture[..., 1], picture[..., 2]
    bright = green > 60
    # Of hundreds in a green key.
    assert (bright & (green > 1.3 * red) & (green > 1.3 * blue)).sum() < 20
    silent = frames[-1].astype(int)
    reds = [
        ((p[..., 0] > 1.5 * p[..., 1]) & (p[..., 0] > 1.5 * p[..., 2])).sum()
        for p in (picture, silent)
    ]
    assert reds[0] > reds[1] + 50


def test_where_no_key_is_pressed_there_is_silence_and_no_midi_file(piano_run, midi_file, capsys):
    run = piano_run(rest_action(str(midi_file))).path
    (run / "play").mkdir()
    (run / "play" / "performance.mid").write_text("of another performance")
    played = play_run(run, picture=None)
    assert played.midi is None
    assert main(["play", str(run), "--no-video"]) == 0
    assert "no key was pressed, so there is no MIDI file" in capsys.readouterr().out
    assert names_in(run / "play") == SILENT
    rate, samples = wavfile.read(played.wav)
    assert not samples.any()
    assert len(samples) / rate == pytest.approx(26 * 0.05)  # 1.2 s: 25 steps, 26 pictures


def test_a_run_that_is_no_pianos_and_a_folder_that_cannot_be_made_are_refused(
    pendulum_run, tmp_path
):
    folder = pendulum_run().path
    with pytest.raises(RunError, match="cannot be watched: its environment 'Pendulum-v1' is no"):
        play_run(folder)
    assert not (folder / "play").exists()
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RunError, match="'.*file' cannot be written: .* Expected a folder"):
        play_score(PIECE, tmp_path / "file", picture=None)


@tables("setting, expected")
def test_a_picture_that_cannot_be_drawn_is_refused(setting, expected):
    with pytest.raises(ConfigError, match=expected):
        Picture(**setting)


@tables("title, name")
def test_a_piece_has_a_folder_by_its_title_which_stays_in_its_place(
    title, name, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    piece = Score(notes=PIECE.notes, title=title)
    assert play_score(piece, picture=None).folder.parts == ("play", name)
    assert names_in(tmp_path / "play") == [name]


# The command.


def test_a_folder_is_played_as_a_run_and_a_file_as_a_piece(piano_run, tmp_path, capsys):
    run = piano_run(LOUD, physics="fast").path
    assert main(["play", str(run), "--no-video"]) == 0
    assert names_in(run / "play") == ["performance.mid", *SILENT]
    # Another piece has a folder of its own.
    assert play_run(run, score=PIECE, picture=None).folder == run / "play" / "three_notes"
    take = episode_of(run, score=PIECE)
    assert take.piano.title == "three notes"
    assert take.piano.roll.onset.sum() == 3
    assert len(take.qpos) == len(take.piano.roll) + 1
    write_midi(PIECE, tmp_path / "piece.mid")
    out = tmp_path / "out"
    assert main([*SCORE, str(tmp_path / "piece.mid"), "--no-video", "--out", str(out)]) == 0
    assert len(read_midi(out / "performance.mid").notes) == 3
    printed = capsys.readouterr()
    assert f"MIDI:  {out}/performance.mid\nSound: {out}/performance.wav" in printed.out
    assert "performance.wav (velocities 60 to 100, as written)\n" in printed.out
    assert "Video" not in printed.out
    assert printed.err == ""


@pytest.mark.slow
def test_notes_are_as_loud_as_keys_were_struck_unless_all_are_to_be_equal(tmp_path, capsys):
    command = ["play", "CMajorScaleOneHand", "--physics", "fast", "--no-video", "--out"]
    assert main([*command, str(tmp_path / "struck")]) == 0
    assert re.search(r"\(velocities \d+ to \d+, as struck\)\n", capsys.readouterr().out)
    assert main([*command, str(tmp_path / "flat"), "--flat"]) == 0
    assert "(all notes of velocity 80)" in capsys.readouterr().out
    struck, flat = (
        [note.velocity for note in read_midi(tmp_path / name / "performance.mid").notes]
        for name in ("struck", "flat")
    )
    assert len(struck) == len(flat) > 5
    assert max(struck) - min(struck) > 10
    assert set(flat) == {80}


def test_where_nothing_can_be_drawn_the_command_says_so_after_writing_the_rest(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    command = [*SCORE, "CMajorScaleOneHand", "--out", str(tmp_path)]
    assert main(command) == 2
    assert names_in(tmp_path) == ["performance.mid", "performance.wav"]
    printed = capsys.readouterr()
    assert "Sound: " in printed.out
    assert "There is no video. Cannot draw the scene: MUJOCO_GL is 'disable'" in printed.err
    assert main([*command, "--no-video"]) == 0
    assert capsys.readouterr().err == ""


def test_a_window_without_a_screen_is_an_error_before_anything_is_played(
    tmp_path, monkeypatch, capsys
):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    command = ["play", "CMajorScaleOneHand", "--human", "--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert not (tmp_path / "out").exists()
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("sb3-piano: error: Cannot open a window: there is no screen")
