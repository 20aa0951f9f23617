"""Finger usage: the finger on each key, and the distribution of the pressing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FingerArray, FloatArray
from sb3_piano.music.constants import NUM_FINGERS

_NO_FINGER = -1


class KeyBoxes(NamedTuple):
    """Boxes of the keys, in the world."""

    center: FloatArray
    """(88, 3) m."""
    rotation: FloatArray
    """(88, 3, 3) axes of the box in the world, as columns."""
    half_size: FloatArray
    """(88, 3) half lengths along the axes, m."""


def nearest_fingers(
    sounding: npt.ArrayLike, fingertips: npt.ArrayLike, boxes: KeyBoxes
) -> FingerArray:
    """Attribute each sounding key to the finger with the nearest tip.

    The distance of a point to a box with axes R, centre c and half sizes h is the length of
    ``max(|R^T (p - c)| - h, 0)``, which is 0 inside. If several tips are equally near, as inside
    the box, the lowest finger has pressed it.

    Source: the curriculum-strategies report on RoboPianist, section 3, "we attribute every key
    contact to the nearest fingertip". It leaves open from where on the key; here it is the box.

    Args:
        sounding: (T, 88) bool, keys that sound at the end of each control step.
        fingertips: (T, 10, 3) where the fingertips are then, in m; right thumb to little finger,
            then left.
        boxes: Where the keys are.

    Returns:
        (T, 88) int8, the finger (0-9), -1 where the key is silent.
    """
    sounding = np.asarray(sounding, dtype=bool)
    fingers = np.full(sounding.shape, _NO_FINGER, dtype=np.int8)
    cells = np.flatnonzero(sounding)  # five times as fast as np.nonzero of both axes
    if len(cells) == 0:
        return fingers
    step, key = np.divmod(cells, sounding.shape[1])
    offset = np.asarray(fingertips)[step] - boxes.center[key, None]  # (n, 10, 3)
    local = offset @ boxes.rotation[key]  # a row vector times R is R^T times the vector
    outside = np.maximum(np.abs(local) - boxes.half_size[key, None], 0.0)
    outside *= outside
    x, y, z = np.moveaxis(outside, 2, 0)
    fingers.reshape(-1)[cells] = (x + y + z).argmin(axis=1)
    return fingers


def finger_shares(press_finger: npt.ArrayLike) -> FloatArray:
    """Return each finger's share of the pressing.

    ``n_f / sum(n)`` with ``n_f`` the number of pairs of a control step and a key in which the key
    sounds under finger f: a key that is held for long counts for long.

    Source: the curriculum-strategies report on RoboPianist, "press frames per finger".

    Args:
        press_finger: (T, n) int, the finger (0-9) at each sounding key, -1 where it is silent.

    Returns:
        (10,) shares with the sum 1; all 0 if no key ever sounds.
    """
    fingers = np.asarray(press_finger)
    counts = np.bincount(fingers[fingers >= 0], minlength=NUM_FINGERS)
    return counts / max(counts.sum(), 1)


def effective_fingers(shares: npt.ArrayLike) -> float:
    """Return the effective number of fingers, the exponential of the shares' entropy.

    ``exp(-sum_f p_f ln p_f)`` over the fingers with ``p_f > 0``, the shares made to sum to 1 first,
    so that the five of one hand can be passed: 1 if one finger does all, n if n do equally much.

    Source: the curriculum-strategies report on RoboPianist, appendix, ``N_eff``.

    Args:
        shares: (n,) shares or counts, at least 0.

    Returns:
        The number, in [1, n]; 0.0 if all shares are 0.
    """
    shares = np.asarray(shares, dtype=float)
    shares = shares[shares > 0]
    if len(shares) == 0:
        return 0.0
    shares = shares / shares.sum()
    return float(np.exp(-np.sum(shares * np.log(shares))))


def fingering_agreement(press_finger: npt.ArrayLike, target_finger: npt.ArrayLike) -> float:
    """Return the share of rightly pressed, labelled keys pressed by the labelled finger.

    Over all pairs of a control step and a key in which the key sounds and is due with a finger
    label: how many of them have that very finger on the key, divided by how many there are.

    Args:
        press_finger: (T, n) int, the finger (0-9) at each sounding key, -1 where it is silent.
        target_finger: (T, n) int, the label (0-9) of each key that is due, -1 where it is not due
            or has no label.

    Returns:
        The share, in [0, 1]; 1.0 if there is no such pair.

    Raises:
        ValueError: If the shapes differ.
    """
    pressed, label = np.asarray(press_finger), np.asarray(target_finger)
    if pressed.shape != label.shape:
        raise ValueError(
            f"Fingers pressed and fingers due must be arrays of one shape, got {pressed.shape} and "
            f"{label.shape}."
        )
    agrees = (pressed == label)[(pressed >= 0) & (label >= 0)]
    return float(agrees.mean()) if len(agrees) else 1.0
