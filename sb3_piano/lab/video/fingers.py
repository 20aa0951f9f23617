"""Choose a finger for each note from the fingertips around its onset."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.lab.video.keyboard import BLACK_FRONT, CENTERS, KEY_LENGTH, KeyboardPlane
from sb3_piano.lab.video.landmarks import Landmarks
from sb3_piano.metrics.musicianship import chords
from sb3_piano.music import MIN_PITCH, Score
from sb3_piano.music.constants import (
    FINGERS_PER_HAND,
    KEY_IS_BLACK,
    NUM_FINGERS,
    UNKNOWN_FINGER,
)
from sb3_piano.music.pitch import pitch_name
from sb3_piano.settings import Positive, Share, settings


@settings
class FingerSettings:
    """How fingers are chosen.

    Raises:
        ConfigError: If a value is out of range.
    """

    window: Positive = 0.1
    """Pictures of this time before and after an onset count, s; at least the nearest one."""
    temperature: Positive = 0.2
    """Difference of distances, in widths of a white key, that makes a finger e times as likely."""
    least: Share = 0.5
    """A finger that is less likely leaves the note without one."""


def finger_probabilities(
    score: Score,
    onsets: FloatArray,
    landmarks: Landmarks,
    plane: KeyboardPlane,
    settings: FingerSettings | None = None,
) -> FloatArray:
    """Return how likely each finger played each note.

    ``p_f ~ exp(-sum_t c_tf d_tf / (T sum_t c_tf))`` over the pictures t around the onset, with c
    the detector's confidence, d the distance of the fingertip from the key's middle line in widths
    of a white key, and T the temperature. The pictures nearest to the onset weigh most.

    Source: a confidence-weighted soft-argmin, the curriculum-strategies report, section 6.4, which
    leaves distances and weights open.

    Args:
        score: The notes.
        onsets: (n,) when each note is struck in the video, s; NaN where it is not known.
        landmarks: The hands.
        plane: The keyboard.
        settings: How fingers are chosen.

    Returns:
        (n, 10) probabilities, whose sum is 1, or 0 where no finger is seen.
    """
    chosen = settings or FingerSettings()
    places = plane.to_keys(landmarks.tips())  # (T, 10, 2)
    sure = np.repeat(landmarks.confidence, FINGERS_PER_HAND, axis=1) * np.isfinite(places).all(
        axis=-1
    )
    places = np.nan_to_num(places)
    found = np.zeros((len(score.notes), NUM_FINGERS))
    for row, note in enumerate(score.notes):
        if not np.isfinite(onsets[row]):
            continue
        away = np.abs(landmarks.time - onsets[row])
        near = np.flatnonzero(away <= max(chosen.window, away.min()))
        if away.min() > 2 * chosen.window:
            continue  # before the video begins, after its end, or where pictures are missing
        weights = sure[near] * np.exp(-0.5 * (away[near] / (0.5 * chosen.window)) ** 2)[:, None]
        total = weights.sum(axis=0)
        seen = total > 1e-6
        if not seen.any():
            continue
        d = _distance(places[near], note.pitch - MIN_PITCH)
        mean = (weights * d).sum(axis=0)[seen] / total[seen]
        likely = np.exp(-(mean - mean.min()) / chosen.temperature)
        found[row, seen] = likely / likely.sum()
    return found


def _distance(places: FloatArray, key: int) -> FloatArray:
    """Return how far (..., 2) places are from a key, in widths of a white key."""
    front = BLACK_FRONT if KEY_IS_BLACK[key] else 0.0
    beyond = np.maximum(front - places[..., 1], 0) + np.maximum(places[..., 1] - 1, 0)
    return np.hypot(places[..., 0] - CENTERS[key], KEY_LENGTH * beyond)


def choose_fingers(
    score: Score, probabilities: FloatArray, least: float = FingerSettings().least
) -> tuple[IntArray, FloatArray]:
    """Choose the most likely finger of each note; notes struck together have different ones.

    Args:
        score: The notes.
        probabilities: (n, 10) from :func:`finger_probabilities`.
        least: A less likely finger leaves the note without one.

    Returns:
        (n,) fingers, -1 where it is open, and (n,) how likely the most likely one is.
    """
    fingers = np.full(len(score.notes), UNKNOWN_FINGER)
    for chord in chords(np.array([note.onset for note in score.notes])):
        cost = -np.log(np.maximum(probabilities[chord], 1e-9))
        rows, columns = linear_sum_assignment(cost)
        fingers[chord[rows]] = columns
    likely = np.take_along_axis(probabilities, np.maximum(fingers, 0)[:, None], axis=1)[:, 0]
    return np.where(likely >= least, fingers, UNKNOWN_FINGER), likely


def table_of(score: Score, fingers: IntArray, likely: FloatArray) -> str:
    """Return the CSV that ``fingering=`` takes: onset, pitch, finger and how likely it is."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["onset", "pitch", "finger", "probability"])
    for note, finger, p in zip(score.notes, fingers, likely, strict=True):
        name = "" if finger == UNKNOWN_FINGER else int(finger)
        writer.writerow([f"{note.onset:.4f}", pitch_name(note.pitch), name, f"{p:.3f}"])
    return text.getvalue()


def macro_f1(found: Sequence[int] | IntArray, truth: Sequence[int] | IntArray) -> float:
    """Return the mean over fingers of the F1 of their notes.

    A note whose finger is left open is missed. Fingers that are in neither count for nothing.

    Args:
        found: (n,) fingers, -1 where it is open.
        truth: (n,) fingers, -1 where it is unknown: these notes are left out.
    """
    known = np.asarray(truth) != UNKNOWN_FINGER
    f, t = np.asarray(found)[known], np.asarray(truth)[known]
    scores = [
        2 * ((f == k) & (t == k)).sum() / max((f == k).sum() + (t == k).sum(), 1)
        for k in range(NUM_FINGERS)
        if (f == k).any() or (t == k).any()
    ]
    return float(np.mean(scores)) if scores else 0.0
