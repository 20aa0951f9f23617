"""Pages: fingers that were found in a video, and corners of the keyboard to click."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.lab.video.alignment import Alignment
from sb3_piano.lab.video.keyboard import KeyboardPlane, import_cv2
from sb3_piano.lab.video.landmarks import Landmarks
from sb3_piano.lab.video.video_file import pictures_at
from sb3_piano.music import MIN_PITCH, Score
from sb3_piano.music.constants import (
    FINGERS_PER_HAND,
    KEY_IS_BLACK,
    NUM_FINGERS,
    NUM_KEYS,
    UNKNOWN_FINGER,
)
from sb3_piano.music.hands import HANDS
from sb3_piano.music.pitch import pitch_name
from sb3_piano.viewing.moment import FINGER_COLORS
from sb3_piano.viewing.report.page import FINGERS, render
from sb3_piano.viewing.video import Frame

_DOUBTFUL = 12
_WIDTH = 420  # pixels of a doubtful note's picture
_KEYS = 7.0  # widths of a white key on each side of it


def corners_page(picture: Frame) -> str:
    """Return a page in which a click on each corner of the keyboard makes the option to give."""
    return render("corners.html", picture=_jpeg(picture), size=picture.shape[1::-1])


def fingering_page(
    *,
    video: str,
    score: Score,
    alignment: Alignment,
    landmarks: Landmarks,
    plane: KeyboardPlane,
    keyboard: Frame,
    fingers: IntArray,
    likely: FloatArray,
    probabilities: FloatArray,
    agreement: float | None,
) -> str:
    """Return the page: numbers, the keyboard as it was found, and pictures of doubtful notes.

    Args:
        video: Path of the video.
        score: The notes.
        alignment: When they are struck.
        landmarks: The hands.
        plane: The keyboard.
        keyboard: A picture of it.
        fingers: (n,) the chosen fingers, -1 where it is open.
        likely: (n,) how likely they are.
        probabilities: (n, 10) how likely each finger is.
        agreement: Macro F1 with known labels, if any.
    """
    doubtful = sorted(
        np.argsort(likely, kind="stable")[:_DOUBTFUL], key=lambda n: alignment.onsets[n]
    )
    pictures = pictures_at(video, [float(alignment.onsets[note]) for note in doubtful])
    notes = []
    for note, picture in zip(doubtful, pictures, strict=True):
        order = np.argsort(-probabilities[note])[:3]
        notes.append(
            {
                "picture": _jpeg(
                    _close(picture, plane, landmarks, alignment.onsets[note], score, note)
                ),
                "pitch": pitch_name(score.notes[note].pitch),
                "onset": score.notes[note].onset,
                "video": alignment.onsets[note],
                "open": fingers[note] == UNKNOWN_FINGER,
                "fingers": [(_name(f), probabilities[note, f]) for f in order],
            }
        )
    shares = [
        (_name(finger), int((fingers == finger).sum()))
        for finger in range(NUM_FINGERS)
        if (fingers == finger).any()
    ]
    return render(
        "fingering.html",
        title=score.title,
        video=video,
        count=len(fingers),
        open=int((fingers == UNKNOWN_FINGER).sum()),
        alignment=alignment,
        heard=bool(np.isfinite(alignment.hits)),
        seen=landmarks.seen,
        agreement=agreement,
        keyboard=_jpeg(_outlined(keyboard, plane)),
        notes=notes,
        shares=shares,
    )


def _name(finger: int) -> str:
    hand, place = divmod(finger, FINGERS_PER_HAND)
    return f"{HANDS[hand]} {FINGERS[place].replace('-finger', '')}"


def _outlined(picture: Frame, plane: KeyboardPlane) -> Frame:
    drawn = picture.copy()
    for key in range(NUM_KEYS):
        _polygon(
            drawn, plane.outline(key), (230, 60, 40) if KEY_IS_BLACK[key] else (20, 150, 60), 1
        )
    return drawn


def _close(
    picture: Frame,
    plane: KeyboardPlane,
    landmarks: Landmarks,
    time: float,
    score: Score,
    note: int,
) -> Frame:
    """Return the picture around a key, with its outline and the fingertips."""
    cv2, drawn = import_cv2(), picture.copy()
    key = score.notes[note].pitch - MIN_PITCH
    outline = plane.outline(key)
    _polygon(drawn, outline, (230, 60, 40), 2)
    nearest = int(np.abs(landmarks.time - time).argmin())
    for finger, tip in enumerate(landmarks.tips()[nearest]):
        if np.isfinite(tip).all():
            color = [round(255 * part) for part in FINGER_COLORS[finger % FINGERS_PER_HAND][:3]]
            place = tuple(int(x) for x in np.round(tip))
            cv2.circle(drawn, place, 5, color, -1)
            cv2.circle(drawn, place, 5, (255, 255, 255), 1)
    middle = plane.to_keys(outline.mean(axis=0))
    edges = plane.to_pixels([(middle[0] + side * _KEYS, 0.5) for side in (-1, 1)])
    x, y = outline.mean(axis=0)
    half = max(float(np.abs(edges[:, 0] - x).max()), 20.0)
    height, width = drawn.shape[:2]
    left, right = (int(np.clip(x + side * half, 0, width)) for side in (-1, 1))
    top, bottom = (int(np.clip(y + side * half * 0.8, 0, height)) for side in (-1, 1))
    part = drawn[top : max(bottom, top + 1), left : max(right, left + 1)]
    scale = _WIDTH / part.shape[1]
    return cv2.resize(part, (_WIDTH, max(round(part.shape[0] * scale), 1)))


def _polygon(picture: Frame, corners: FloatArray, color: Sequence[int], width: int) -> None:
    points: Any = [np.round(corners).astype(np.int32)]
    import_cv2().polylines(picture, points, True, color, width)


def _jpeg(picture: Frame) -> str:
    cv2 = import_cv2()
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]))
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
