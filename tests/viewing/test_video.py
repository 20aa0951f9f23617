"""Video files, read back with another library than the one that wrote them."""

import os
import stat
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from hearing import loudness, onsets_in
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError, RenderingError
from sb3_piano.music import synthesize, write_wav
from sb3_piano.music.synthesis import SAMPLE_RATE
from sb3_piano.viewing import write_video

tables = Tables(__file__)

SIZE = (64, 48)


def grey(level):
    return np.full((48, 64, 3), level, dtype=np.uint8)


def pictures_of(path):
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def sound_of(path):
    with av.open(str(path)) as container:
        rate = container.streams.audio[0].rate
        return np.concatenate([f.to_ndarray() for f in container.decode(audio=0)], axis=1).T, rate


def children_of_this_process():
    own = str(os.getpid())
    stats = [p.read_text().rsplit(")", 1)[1].split() for p in Path("/proc").glob("[0-9]*/stat")]
    return sum(fields[1] == own for fields in stats)


@pytest.fixture
def wav(tmp_path):
    """A sound file of notes that are struck at 0.21, 0.75 and 1.3333 s; 2.5 s long."""
    notes = ((time, time + 0.1, 60 + i) for i, time in enumerate((0.21, 0.75, 1.3333)))
    path = tmp_path / "sound.wav"
    write_wav(path, synthesize(score_of(*notes), at_least=2.5))
    return path


@pytest.mark.slow
def test_a_relative_path_may_look_like_an_address(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("10:30").mkdir()
    write_video(Path("10:30/v.mp4"), [grey(100)], 20.0, None, SIZE)
    assert len(pictures_of(tmp_path / "10:30" / "v.mp4")) == 1


def test_pictures_come_back_in_their_order_size_and_rate(tmp_path):
    levels = [20, 220, 90, 160, 40, 250, 130]
    write_video(tmp_path / "v.mp4", (grey(level) for level in levels), 20.0, None, SIZE)
    read = pictures_of(tmp_path / "v.mp4")
    assert [picture.shape for picture in read] == [(48, 64, 3)] * len(levels)
    np.testing.assert_allclose([picture.mean() for picture in read], levels, atol=6)
    with av.open(str(tmp_path / "v.mp4")) as container:
        (stream,) = container.streams
        assert stream.average_rate == 20
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
    assert [path.name for path in tmp_path.iterdir()] == ["v.mp4"]


def test_the_notes_of_the_sound_track_begin_when_they_are_struck(tmp_path, wav):
    write_video(tmp_path / "v.mp4", [grey(9)] * 40, 20.0, wav, SIZE)
    sound, rate = sound_of(tmp_path / "v.mp4")
    assert sound.shape[1] == 2
    assert rate == SAMPLE_RATE
    np.testing.assert_allclose(onsets_in(sound, rate), [0.21, 0.75, 1.3333], atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("n_pictures", [20, 67, 100])
def test_the_sound_is_cut_or_filled_up_to_the_length_of_the_pictures(tmp_path, wav, n_pictures):
    write_video(tmp_path / "v.mp4", [grey(9)] * n_pictures, 20.0, wav, SIZE)
    sound, rate = sound_of(tmp_path / "v.mp4")
    assert len(pictures_of(tmp_path / "v.mp4")) == n_pictures
    assert len(sound) / rate == pytest.approx(n_pictures / 20.0, abs=0.025)
    if n_pictures == 100:
        assert loudness(sound, rate, 3.0, 4.9) < 1e-4


def test_each_picture_is_written_before_the_next_is_drawn(tmp_path):
    events = []

    def draw():
        for k in range(1, 4):
            assert not (tmp_path / "v.mp4").exists()  # before it is whole
            events.append(f"draw {k}")
            yield grey(9)

    def note(done):
        events.append(f"done {done}")

    write_video(tmp_path / "v.mp4", draw(), 1.0 / 0.03, None, SIZE, progress=note)
    assert events == ["draw 1", "done 1", "draw 2", "done 2", "draw 3", "done 3"]
    with av.open(str(tmp_path / "v.mp4")) as container:
        assert container.streams.video[0].average_rate == Fraction(100, 3)


@tables("changes, message")
def test_wrong_arguments_are_told_before_anything_is_drawn(tmp_path, changes, message):
    arguments = {"fps": 20.0, "audio": None, "size": SIZE, **changes}
    with pytest.raises(ConfigError, match=message):
        write_video(tmp_path / "v.mp4", iter(int, 1), **arguments)


def test_two_that_write_a_video_at_once_do_not_disturb_each_other(tmp_path):
    file = tmp_path / "v.mp4"

    def draw():
        yield grey(20)
        write_video(file, [grey(220)] * 2, 20.0, None, SIZE)
        assert len(pictures_of(file)) == 2
        yield grey(20)
        yield grey(20)

    write_video(file, draw(), 20.0, None, SIZE)
    assert [round(picture.mean(), -1) for picture in pictures_of(file)] == [20, 20, 20]
    assert [path.name for path in tmp_path.iterdir()] == ["v.mp4"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_while_drawing_leaves_the_former_file_and_no_process(tmp_path, error):
    (tmp_path / "v.mp4").write_text("former")
    before = children_of_this_process()

    def draw():
        yield grey(9)
        yield grey(9)
        raise error("drawing failed")

    with pytest.raises(error, match="drawing failed"):
        write_video(tmp_path / "v.mp4", draw(), 20.0, None, SIZE)
    assert [path.name for path in tmp_path.iterdir()] == ["v.mp4"]
    assert (tmp_path / "v.mp4").read_text() == "former"
    assert children_of_this_process() == before


@pytest.mark.parametrize("picture", [grey(9)[:-2], grey(9)[..., :2], grey(9).astype(float)])
def test_a_picture_of_another_kind_is_refused(tmp_path, picture):
    with pytest.raises(RenderingError, match=r"Cannot write '.*v.mp4': there are no pictures"):
        write_video(tmp_path / "v.mp4", [], 20.0, None, SIZE)
    with pytest.raises(
        RenderingError, match=r"A picture has shape .*: expected \(48, 64, 3\) uint8"
    ):
        write_video(tmp_path / "v.mp4", [grey(9), picture], 20.0, None, SIZE)
    assert not list(tmp_path.iterdir())


def test_what_ffmpeg_complains_about_is_told(tmp_path):
    with pytest.raises(RenderingError, match=r"Cannot write the video '.*no/v.mp4'.*No such file"):
        write_video(tmp_path / "no" / "v.mp4", [grey(9)], 20.0, None, SIZE)
    (tmp_path / "noise.wav").write_text("not a sound")
    with pytest.raises(RenderingError, match=r"Cannot write the video '.*v.mp4'.*noise.wav"):
        write_video(tmp_path / "v.mp4", [grey(9)], 20.0, tmp_path / "noise.wav", SIZE)
    assert [path.name for path in tmp_path.iterdir()] == ["noise.wav"]


@pytest.mark.parametrize(
    ("program", "message"),
    [("/nonexistent", r"'/nonexistent' cannot be run \(No such"), ("true", "writes no file")],
)
def test_a_program_that_is_no_encoder_is_named_with_the_cure(
    tmp_path, monkeypatch, program, message
):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", program)
    with pytest.raises(RenderingError, match=f"{message}.*IMAGEIO_FFMPEG_EXE"):
        write_video(tmp_path / "v.mp4", [grey(9)], 20.0, None, SIZE)
    assert not list(tmp_path.iterdir())


def test_an_encoder_that_fails_at_the_end_leaves_no_video(tmp_path, monkeypatch):
    encoder = tmp_path / "ffmpeg"
    encoder.write_text(
        '#!/bin/sh\nfor last; do :; done\ncat > "$last"\necho disk full >&2\nexit 3\n'
    )
    encoder.chmod(encoder.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(encoder))
    with pytest.raises(RenderingError, match="ffmpeg ended with 3 and said: disk full"):
        write_video(tmp_path / "v.mp4", [grey(9)] * 3, 20.0, None, SIZE)
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]
