"""``sb3-piano fingering-from-video``: fingers of a filmed pianist, as a table of labels."""

from __future__ import annotations

import argparse
import os
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import EXIT_OK, check_output_file, command
from sb3_piano.exceptions import ConfigError
from sb3_piano.files import write_text

if TYPE_CHECKING:
    from sb3_piano.lab.video.alignment import Alignment
    from sb3_piano.lab.video.keyboard import KeyboardPlane
    from sb3_piano.lab.video.landmarks import Landmarks
    from sb3_piano.music import Score
    from sb3_piano.viewing.video import Frame

_KEYS = ["A0", "C8"]


def add_arguments(parser: Any) -> None:
    """Add the command's arguments."""
    about = "Find which finger a filmed pianist used for each note, as labels for 'fingering'."
    add = command(parser, _run, description=about)
    add("video", "VIDEO", "the video, filmed from above by a camera that does not move", Path)
    add("score", "SCORE", "the piece: a file or a name; played once from beginning to end")
    add("--out", "FILE.csv", "the table of labels", Path, Path("fingers.csv"))
    add("--page", "FILE.html", "page about the result; default: beside the table", Path)
    add("--landmarks", "FILE.npz", "landmarks of the hands; default: beside the table", Path)
    add(
        "--detector",
        "PYTHON",
        "Python with MediaPipe, to make the landmarks if there are none yet",
    )
    add(
        "--corners",
        "X,Y",
        "corners of the keys in pixels: front left, front right, back right, back left; default: "
        "they are searched for",
        nargs=4,
    )
    add("--keys", "KEY", "lowest and highest white key between the corners", nargs=2, default=_KEYS)
    add("--offset", "S", "when the first note sounds, for a video without sound", float)
    add("--truth", "FILE", "file with labels, to measure the agreement with")
    add("--least", "P", "a finger that is less likely leaves its note open", float)


def _run(arguments: argparse.Namespace) -> int:
    import numpy as np

    from sb3_piano.lab.video.fingers import (
        FingerSettings,
        choose_fingers,
        finger_probabilities,
        macro_f1,
        table_of,
    )
    from sb3_piano.lab.video.page import fingering_page
    from sb3_piano.lab.video.video_file import empty_keyboard
    from sb3_piano.music import load_score
    from sb3_piano.music.fingering import without_fingers
    from sb3_piano.music.fingering.labels import read_labels

    out = arguments.out
    page = arguments.page or out.with_suffix(".html")
    for option, file in (("--out", out), ("--page", page)):
        check_output_file(option, file)
    given = {} if arguments.least is None else {"least": arguments.least}
    settings = FingerSettings(**given)
    score = without_fingers(load_score(arguments.score), keep_hands=False)
    keyboard = empty_keyboard(arguments.video)
    plane = _plane(arguments, keyboard, out)
    landmarks = _landmarks(arguments, out)
    alignment = _alignment(arguments, score)
    likely_of = finger_probabilities(score, alignment.onsets, landmarks, plane, settings)
    fingers, likely = choose_fingers(score, likely_of, settings.least)
    agreement = None
    if arguments.truth is not None:
        truth = read_labels(arguments.truth, score)
        agreement = macro_f1(fingers, [note.finger for note in truth.notes])
    write_text(out, table_of(score, fingers, likely))
    text = fingering_page(
        video=os.fspath(arguments.video),
        score=score,
        alignment=alignment,
        landmarks=landmarks,
        plane=plane,
        keyboard=keyboard,
        fingers=fingers,
        likely=likely,
        probabilities=likely_of,
        agreement=agreement,
    )
    write_text(page, text)
    found = int(np.count_nonzero(fingers >= 0))
    print(f"{found} of {len(fingers)} notes have a finger; the others are open.")
    if np.isfinite(alignment.hits):
        print(f"{alignment.hits:.0%} of the onsets are heard in their places.")
    if agreement is not None:
        print(f"Macro F1 with '{arguments.truth}': {agreement:.3f}")
    print(f"Labels: {out}\nPage:   {page}")
    print(f"Use:    sb3-piano train --midi {arguments.score} --fingering {out}")
    return EXIT_OK


def _plane(arguments: argparse.Namespace, keyboard: Frame, out: Path) -> KeyboardPlane:
    from sb3_piano.lab.video.keyboard import KeyboardPlane, find_keyboard
    from sb3_piano.lab.video.page import corners_page
    from sb3_piano.music import MIN_PITCH
    from sb3_piano.music.pitch import pitch_number

    if arguments.corners is None:
        if arguments.keys != _KEYS:
            raise ConfigError("--keys is given without --corners, between which they are.")
        try:
            return find_keyboard(keyboard)
        except ConfigError as error:
            page = out.with_name(f"{out.stem}_corners.html")
            write_text(page, corners_page(keyboard))
            raise ConfigError(f"{error} '{page}' makes the option from four clicks.") from error
    try:
        corners = [[float(number) for number in text.split(",")] for text in arguments.corners]
        if any(len(corner) != 2 for corner in corners):
            raise ValueError
    except ValueError:
        raise ConfigError(
            f"--corners {' '.join(arguments.corners)}: expected four pairs such as 120,430."
        ) from None
    first, last = (pitch_number(name) - MIN_PITCH for name in arguments.keys)
    return KeyboardPlane.of_corners(corners, first, last)


def _landmarks(arguments: argparse.Namespace, out: Path) -> Landmarks:
    from sb3_piano.lab.video import detect_hands
    from sb3_piano.lab.video.landmarks import Landmarks
    from sb3_piano.music.hands import HANDS

    file = arguments.landmarks or out.with_name(f"{out.stem}_landmarks.npz")
    if not file.exists() and arguments.detector is None:
        raise ConfigError(
            f"There are no landmarks '{file}': expected --landmarks FILE.npz, or --detector PYTHON "
            "with a Python that has MediaPipe: python -m venv hands && hands/bin/pip install "
            "mediapipe==0.10.21"
        )
    if not file.exists():
        program = [arguments.detector, str(detect_hands.__file__), str(arguments.video), str(file)]
        try:
            done = subprocess.run(program, capture_output=True, text=True, check=False)
        except OSError as error:
            raise ConfigError(
                f"--detector '{arguments.detector}' cannot be run: {error.strerror}. Expected a "
                "Python, such as hands/bin/python."
            ) from error
        if done.returncode:
            said = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
            raise ConfigError(
                f"The detector failed: {said}. Expected a Python with MediaPipe: "
                f"{arguments.detector} -m pip install mediapipe==0.10.21"
            )
    landmarks = Landmarks.read(file)
    for side, share in zip(HANDS, landmarks.seen, strict=True):
        if share == 0:
            print(f"The {side} hand is in no picture: its notes are given to the other one.")
    return landmarks


def _alignment(arguments: argparse.Namespace, score: Score) -> Alignment:
    from sb3_piano.lab.video.alignment import align, constant_tempo, read_sound

    if arguments.offset is not None:
        return constant_tempo(score, arguments.offset)
    return align(score, read_sound(arguments.video))
