"""Closeness of keys and fingers to where they should be: what terms of the reward are made of.

Source of all of it: RoboPianist (Zakka et al. 2023), its public task ``PianoWithShadowHands``; the
optimal-transport fingering is RP1M's (Zhao et al. 2024).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sb3_piano.arrays import FloatArray

# A key counts as pressed, and a finger as on its key, within these distances; the reward has
# fallen to a tenth at ten times as much beyond.
_KEY_TOLERANCE = 0.05  # share of the key's travel
_FINGER_TOLERANCE = 0.01  # m


def tolerance(distance: float, bound: float, margin: float) -> float:
    """Return 1 where ``0 <= distance <= bound``, falling as a Gaussian to 0.1 at ``margin`` beyond.

    Source: dm_control's ``rewards.tolerance`` with ``bounds=(0, bound)``.
    """
    outside = max(distance - bound, -distance, 0.0) / margin
    closeness: float = 0.1 ** (outside * outside)
    return closeness


def _mean_closeness(distances: Sequence[float], bound: float) -> float:
    """Return the mean tolerance of distances, of which there is at least one."""
    margin = 10 * bound
    # There are few, for which plain numbers are faster than numpy; and this is every control step.
    values = [tolerance(distance, bound, margin) for distance in distances]
    return sum(values) / len(values)


def _distance(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the distances between points along the last axis."""
    offset = a - b
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", offset, offset)))


# The pedal and its goal are each 0 or 1, so their difference has three values.
_SUSTAIN = {d: tolerance(d, _KEY_TOLERANCE, 10 * _KEY_TOLERANCE) for d in (-1, 0, 1)}


def held(missing: Sequence[float]) -> float:
    """Return the mean closeness of keys to being fully down; 0 if there is none.

    Args:
        missing: For each of them, the share of its travel that is left.
    """
    return _mean_closeness(missing, _KEY_TOLERANCE) if missing else 0.0


def sustain(due: bool, pressed: bool) -> float:
    """Reward holding the pedal when it is due and releasing it when it is not.

    Returns:
        1 if both agree, else nearly 0.
    """
    return _SUSTAIN[due - pressed]


def labelled_fingering(distances: Sequence[float]) -> float:
    """Reward the labelled fingers for being at the keys they should press.

    Args:
        distances: For each labelled note due, how far its finger's tip is from where it should
            press, m.

    Returns:
        The mean closeness in [0, 1]; 0 if no labelled note is due.
    """
    return _mean_closeness(distances, _FINGER_TOLERANCE) if distances else 0.0


def optimal_transport_fingering(fingertips: FloatArray, press_points: FloatArray) -> float:
    """Reward fingertips near the due keys, under the assignment with the least total distance.

    Source: RP1M (Zhao et al. 2024), for scores without finger labels.

    Args:
        fingertips: (10, 3) positions of all fingertips, m.
        press_points: (n, 3) where the due keys should be pressed, m.

    Returns:
        The mean closeness of the assigned pairs in [0, 1]; 1 if nothing is due.
    """
    if len(press_points) == 0:
        return 1.0
    from scipy.optimize import linear_sum_assignment  # takes 0.4 s, and few pieces need it

    distance = _distance(fingertips[:, None], press_points[None])
    assigned = distance[linear_sum_assignment(distance)]
    return _mean_closeness(assigned.tolist(), _FINGER_TOLERANCE)
