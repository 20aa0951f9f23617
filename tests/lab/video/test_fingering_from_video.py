"""Fingers come out of a video as they went in: keyboard, sound, fingertips, command."""

import dataclasses
import re
import subprocess
import sys

import numpy as np
import pytest
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.video import detect_hands
from sb3_piano.lab.video.alignment import RATE, align, constant_tempo, read_sound
from sb3_piano.lab.video.filmed import Camera, corners, project
from sb3_piano.lab.video.fingers import choose_fingers, finger_probabilities, macro_f1
from sb3_piano.lab.video.keyboard import BLACK_FRONT, CENTERS, KeyboardPlane, find_keyboard
from sb3_piano.lab.video.landmarks import TIPS, Landmarks
from sb3_piano.music import MIN_PITCH, Note, Score, synthesize, write_midi, write_wav
from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.music.fingering.labels import read_labels
from sb3_piano.viewing.video import write_video

tables = Tables(__file__)

cv2 = pytest.importorskip("cv2")

CAMERA = Camera(height=1.1, tilt=25, field=70)


@pytest.fixture(scope="module")
def plane():
    return KeyboardPlane.of_corners(corners(CAMERA))


@pytest.fixture(scope="module")
def picture(plane):
    """A picture of a keyboard as the camera sees it."""
    drawn = np.full((720, 1280, 3), 110, dtype=np.uint8)
    behind = plane.to_pixels([(0, 1), (52, 1), (52, 1.6), (0, 1.6)])
    cv2.fillPoly(drawn, [behind.round().astype(np.int32)], (40, 30, 30))
    for black in (False, True):
        for key in np.flatnonzero(black == KEY_IS_BLACK):
            outline = plane.outline(key).round().astype(np.int32)
            cv2.fillPoly(drawn, [outline], (25, 25, 28) if black else (235, 235, 230))
            cv2.polylines(drawn, [outline], True, (120, 120, 120))
    return drawn


@pytest.fixture(scope="module")
def tune():
    """A melody of both hands with a slow end; each note has the finger that plays it."""
    rng = np.random.default_rng(3)
    notes, onset = [], 0.2
    for k in range(40):
        left = k % 3 == 2
        place = int(rng.integers(5))
        pitch = (48, 50, 52, 53, 55)[4 - place] if left else (60, 62, 64, 65, 67)[place]
        finger = place + 5 * left
        notes.append(Note(onset=onset, offset=onset + 0.25, pitch=pitch, finger=finger))
        onset += 0.3 if k < 25 else 0.42
    return Score(notes=notes, title="tune")


def hands_of(score, plane, times, noise=0.0, seed=0):
    """Landmarks of hands whose finger is on a key while its note sounds, and beside it before."""
    rng = np.random.default_rng(seed)
    places = np.empty((len(times), 10, 2))
    places[:, :5] = np.stack([CENTERS[39] + np.arange(5), np.full(5, 0.25)], axis=1)
    places[:, 5:] = np.stack([CENTERS[34] - np.arange(5), np.full(5, 0.25)], axis=1)
    for note in score.notes:
        sounds = (times > note.onset - 0.05) & (times < note.offset)
        places[sounds, note.finger, 0] = CENTERS[note.pitch - MIN_PITCH]
    points = np.full((len(times), 2, 21, 2), np.nan)
    pixels = plane.to_pixels(places + noise * rng.standard_normal(places.shape) * (1, 1 / 6.4))
    points[:, :, list(TIPS)] = pixels.reshape(-1, 2, 5, 2)
    return Landmarks(times, points, np.full((len(times), 2), 0.9))


def moved(score, time):
    """The score with other times."""
    notes = [
        dataclasses.replace(note, onset=float(time(note.onset)), offset=float(time(note.offset)))
        for note in score.notes
    ]
    return dataclasses.replace(score, notes=tuple(notes))


def sound_of(score, folder):
    write_wav(folder / "heard.wav", synthesize(score))
    return read_sound(folder / "heard.wav")


def unlabelled(score):
    notes = tuple(dataclasses.replace(note, finger=-1, hand=None) for note in score.notes)
    return dataclasses.replace(score, notes=notes)


def test_a_plane_maps_keys_to_where_the_camera_sees_them(plane):
    key = 39  # C4, whose front left corner is 23 white keys from the left end
    world = np.array([0.075, -0.611 + 23 * 0.0235, 0.0225])
    np.testing.assert_allclose(plane.outline(key)[0], project(world, CAMERA), atol=0.5)
    np.testing.assert_allclose(plane.to_keys(plane.to_pixels([(7.5, 0.3)])), [(7.5, 0.3)])


@pytest.mark.parametrize("turn", [0.0, 4.0])
def test_the_keyboard_is_found_by_its_black_keys(picture, plane, turn):
    matrix = cv2.getRotationMatrix2D((640, 360), turn, 1.0)
    found = find_keyboard(cv2.warpAffine(picture, matrix, (1280, 720), borderValue=(90, 90, 90)))
    for u, v in ((0, BLACK_FRONT), (52, BLACK_FRONT), (52, 1), (26, 1)):
        there = matrix @ np.append(plane.to_pixels([(u, v)])[0], 1)
        np.testing.assert_allclose(found.to_pixels([(u, v)])[0], there, atol=4)


@tables("shown, told")
def test_who_is_not_sure_of_the_keyboard_says_so(picture, plane, shown, told):
    seen = np.full_like(picture, 110)
    if shown == "three octaves":
        left, right = (round(float(plane.to_pixels([(u, 0.5)])[0, 0])) for u in (9, 37))
        seen[:, left:right] = picture[:, left:right]
    with pytest.raises(ConfigError, match=f"{told}.*--corners"):
        find_keyboard(seen)


@pytest.mark.parametrize(
    "corners",
    [[(0, 0)] * 4, [(0, 0), (9, 9), (9, 0), (0, 9)], [(0, 0), (9, 0), (np.nan, 9), (0, 9)]],
)
def test_corners_are_a_quadrangle(corners):
    with pytest.raises(ConfigError, match="Corners .*: expected|no quadrangle: expected"):
        KeyboardPlane.of_corners(corners)


@pytest.mark.parametrize(("noise", "least"), [(0.0, 1.0), (0.35, 0.9)])
def test_fingers_are_found_with_the_noise_of_a_detector(plane, tune, noise, least):
    """A third of a key's width is 8 mm; MediaPipe's own figure is 12 % of a palm, 10 mm in all."""
    marks = hands_of(tune, plane, np.arange(0, tune.duration + 1, 1 / 30), noise)
    onsets = np.array([note.onset for note in tune.notes])
    likely = finger_probabilities(unlabelled(tune), onsets, marks, plane)
    np.testing.assert_allclose(likely.sum(axis=1), 1)
    fingers, sure = choose_fingers(unlabelled(tune), likely)
    assert macro_f1(fingers, [note.finger for note in tune.notes]) >= least
    assert ((fingers == -1) == (sure < 0.5)).all()
    marks.confidence[:, 1] = 0  # where no hand is seen, notes stay open
    onsets[0] = np.nan
    fingers, _ = choose_fingers(tune, finger_probabilities(tune, onsets, marks, plane), 0.6)
    assert fingers[0] == -1
    assert (fingers < 5).all()


def test_a_finger_is_on_one_key_of_a_chord(plane):
    chord = Score(notes=[Note(onset=1, offset=2, pitch=p, finger=f) for p, f in ((60, 0), (62, 1))])
    marks = hands_of(chord, plane, np.arange(0, 3, 1 / 30))
    for tip, moved_by in ((4, 0.6), (8, 0.7)):  # the thumb is nearest to both keys
        aside = plane.to_pixels([(moved_by, 0)])[0] - plane.to_pixels([(0, 0)])[0]
        marks.points[:, 0, tip] += aside
    likely = finger_probabilities(chord, np.ones(2), marks, plane)
    assert choose_fingers(chord, likely, 0.0)[0].tolist() == [0, 1]


def test_macro_f1_by_hand():
    # Finger 0: 1 of 2 found, none wrong: 2/3. Finger 1: 1 of 2 right, of 1: 2/3. Finger 2: 0.
    assert macro_f1([0, 1, 1, -1, 4], [0, 0, 1, 2, -1]) == pytest.approx((2 / 3 + 2 / 3 + 0) / 3)


@pytest.mark.slow
@pytest.mark.parametrize("change", ["none", "later and slower", "rubato"])
def test_sound_and_score_are_aligned(tmp_path, tune, change):
    time = {
        "none": lambda t: t,
        "later and slower": lambda t: 1.5 + 1.2 * t,
        "rubato": lambda t: 0.4 + t + 0.6 * np.sin(t / 3),
    }[change]
    struck = moved(tune, time)
    found = align(unlabelled(tune), sound_of(struck, tmp_path))
    error = found.onsets - [note.onset for note in struck.notes]
    assert np.percentile(np.abs(error), 90) < 0.05
    assert found.hits > 0.8
    if change != "rubato":
        assert found.drift == pytest.approx(1.2 if change != "none" else 1.0, abs=0.02)


@pytest.mark.slow
def test_sound_of_another_piece_and_silence_are_told(tmp_path, tune):
    rng = np.random.default_rng(0)
    other = [
        Note(onset=t, offset=t + 0.4, pitch=int(rng.integers(55, 80)))
        for t in np.arange(0, 14, 0.47)
    ]
    with pytest.raises(ConfigError, match=r"does not fit the score 'tune' of 14 s: \d+% of its"):
        align(tune, sound_of(Score(notes=other), tmp_path))
    with pytest.raises(
        ConfigError, match=r"[5-9]\d% of its onsets.*harmonies are \d+% alike \(60%"
    ):
        align(tune.transpose(6), sound_of(tune, tmp_path))  # the same rhythm in other pitches
    with pytest.raises(ConfigError, match=r"sound is silent"):
        align(tune, np.zeros(RATE, dtype=np.float32))


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"time": np.zeros(3)}, "do not grow"),
        ({"points": np.zeros((3, 21, 2))}, r"shapes .*expected an .npz file with"),
        ({"confidence": np.full((3, 2), 2.0)}, "out of range: expected 0 to 1"),
        ({"confidence": np.zeros((3, 2))}, "No hand is found in 3 pictures"),
    ],
)
def test_landmarks_that_are_none_are_told(tmp_path, changed, told):
    whole = {
        "time": np.arange(3.0),
        "points": np.zeros((3, 2, 21, 2)),
        "confidence": np.ones((3, 2)),
    }
    Landmarks(**whole).write(tmp_path / "good.npz")
    assert Landmarks.read(tmp_path / "good.npz").seen.tolist() == [1, 1]
    Landmarks(**{**whole, **changed}).write(tmp_path / "bad.npz")
    with pytest.raises(ConfigError, match=told):
        Landmarks.read(tmp_path / "bad.npz")


@pytest.fixture(scope="module")
def files(tmp_path_factory, picture, plane, tune):
    """A folder with a video of the tune, with and without sound, landmarks, score and labels."""
    folder = tmp_path_factory.mktemp("concert")
    heard = moved(tune, lambda t: t + 0.7)
    n = int(heard.duration + 1)
    write_wav(folder / "sound.wav", synthesize(heard))
    for name, count, sound in (("film.mp4", n, folder / "sound.wav"), ("mute.mp4", 2, None)):
        frames = (picture for _ in range(count))
        write_video(folder / name, frames, fps=1, audio=sound, size=(1280, 720))
    hands_of(heard, plane, np.arange(0, n, 1 / 30), 0.3).write(folder / "hands.npz")
    write_midi(unlabelled(tune), folder / "tune.mid")
    rows = [f"{note.onset},{note.pitch},{note.finger}" for note in tune.notes]
    (folder / "truth.csv").write_text("\n".join(["onset,pitch,finger", *rows]))
    return folder


@pytest.fixture
def concert(files, tmp_path, monkeypatch):
    """The working directory, with these files."""
    monkeypatch.chdir(tmp_path)
    for file in files.iterdir():
        (tmp_path / file.name).symlink_to(file)
    return tmp_path


@pytest.mark.slow
def test_the_command_writes_labels_and_a_page(concert, tune, capsys):
    command = "fingering-from-video film.mp4 tune.mid --landmarks hands.npz --truth truth.csv"
    assert main(command.split()) == 0
    out = capsys.readouterr().out
    assert float(out.partition("Macro F1 with 'truth.csv': ")[2].split()[0]) > 0.9
    labels = read_labels("fingers.csv", unlabelled(tune))
    assert (
        np.mean([a.finger == b.finger for a, b in zip(labels.notes, tune.notes, strict=True)]) > 0.9
    )
    page = (concert / "fingers.html").read_text()
    assert page.count("data:image/jpeg") == 13  # the keyboard and twelve doubtful notes
    assert "Macro F1" in out
    assert "macro F1" in page


@pytest.mark.slow
@tables("options, told")
def test_what_cannot_be_done_is_told_and_nothing_is_written(concert, options, told, capsys):
    assert main(["fingering-from-video", *options.split()]) == 2
    error = capsys.readouterr().err
    assert re.search(told, error), error
    assert not (concert / "fingers.csv").exists()


@pytest.mark.slow
def test_without_sound_the_offset_is_enough(concert, tune, capsys):
    command = "fingering-from-video mute.mp4 tune.mid --landmarks hands.npz --offset 0.9"
    assert main([*command.split(), "--truth", "truth.csv"]) == 0
    out = capsys.readouterr().out
    assert "heard" not in out
    assert float(out.partition("Macro F1 with 'truth.csv': ")[2].split()[0]) > 0.9
    assert constant_tempo(tune, 0.9).onsets[0] == pytest.approx(0.9)
    assert len(read_sound("film.mp4")) > RATE


def test_corners_are_clicked_where_the_keyboard_is_not_found(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_midi(Score(notes=[Note(onset=0, offset=1, pitch=60)]), "tune.mid")
    dark = [np.zeros((64, 64, 3), dtype=np.uint8)] * 3
    write_video("dark.mp4", dark, fps=10, audio=None, size=(64, 64))
    assert main(["fingering-from-video", "dark.mp4", "tune.mid"]) == 2
    assert "'fingers_corners.html' makes the option from four clicks" in capsys.readouterr().err
    assert "--corners" in (tmp_path / "fingers_corners.html").read_text()


def test_the_detector_needs_nothing_of_the_package():
    """It runs in an environment of its own, which has MediaPipe and not this package."""
    program = (
        f"import runpy, sys; runpy.run_path({detect_hands.__file__!r}); "
        "print([name for name in sys.modules if 'sb3' in name or name == 'numpy'])"
    )
    done = subprocess.run([sys.executable, "-I", "-c", program], capture_output=True, text=True)
    assert done.stdout.strip().splitlines()[-1] == "[]"
