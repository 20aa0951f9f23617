"""Find the hands in a video with MediaPipe: a program for a Python of its own.

MediaPipe needs other versions of packages than this one, so it lives in an environment of its own,
whose Python runs this file; nothing of sb3_piano is imported::

    python -m venv hands && hands/bin/pip install mediapipe==0.10.21
    sb3-piano fingering-from-video concert.mp4 score.mid --detector hands/bin/python

Version 0.10.21 is the last whose wheel holds the models. Left and right are told apart by what
MediaPipe says and, if it finds one kind twice, by place.
"""

from __future__ import annotations

import os
import sys


def main(video: str, out: str) -> None:
    """Write the landmarks of a video: time (T,), points (T, 2, 21, 2), confidence (T, 2)."""
    import cv2
    import mediapipe
    import numpy as np

    times: list[float] = []
    points, confidence = [], []
    reader = cv2.VideoCapture(video)
    hands = mediapipe.solutions.hands.Hands(max_num_hands=2, min_detection_confidence=0.3)
    while True:
        time = reader.get(cv2.CAP_PROP_POS_MSEC) / 1000  # of each picture: rates may vary
        found, picture = reader.read()
        if not found:
            break
        height, width = picture.shape[:2]
        result = hands.process(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
        row, sure = np.full((2, 21, 2), np.nan), np.zeros(2)
        seen = []
        for marks, kind in zip(
            result.multi_hand_landmarks or [], result.multi_handedness or [], strict=True
        ):
            pixels = np.array([(mark.x * width, mark.y * height) for mark in marks.landmark])
            # MediaPipe takes pictures for those of a mirror: its left hand is a right one.
            seen.append(
                (kind.classification[0].label == "Right", kind.classification[0].score, pixels)
            )
        if len(seen) == 2 and seen[0][0] == seen[1][0]:
            by_place = sorted(seen, key=lambda hand: hand[2][:, 0].mean())
            seen = [(left, *hand[1:]) for left, hand in zip((True, False), by_place, strict=True)]
        for left, score, pixels in seen:
            row[int(left)], sure[int(left)] = pixels, score
        if not times or time > times[-1]:
            times.append(time)
            points.append(row)
            confidence.append(sure)
    whole = f"{out}.partial.npz"  # what is killed leaves no half file
    np.savez_compressed(
        whole,
        time=np.array(times),
        points=np.array(points).reshape(-1, 2, 21, 2),
        confidence=np.array(confidence).reshape(-1, 2),
    )
    os.replace(whole, out)


if __name__ == "__main__":
    main(*sys.argv[1:3])
