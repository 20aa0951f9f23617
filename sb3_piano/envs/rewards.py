"""Functions for reward terms: closeness of keys and fingers to their targets.

Source: the public task ``PianoWithShadowHands`` of RoboPianist (Zakka et al. 2023). The
optimal-transport fingering is from RP1M (Zhao et al. 2024).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sb3_piano.arrays import FloatArray

# Within these distances a key counts as pressed, and a finger as on its key. At ten times the
# distance beyond, the reward has fallen to a tenth.
_KEY_TOLERANCE = 0.05  # share of the key's travel
_FINGER_TOLERANCE = 0.01  # m


def tolerance(distance: float, bound: float, margin: float) -> float:
    """Return 1 if ``0 <= distance <= bound``, falling as a Gaussian to 0.1 at ``margin`` beyond.

    Source: dm_control's ``rewards.tolerance`` with ``bounds=(0, bound)``.
    """
    outside = max(distance - bound, -distance, 0.0) / margin
    closeness: float = 0.1 ** (outside * outside)
    return closeness


def _mean_closeness(distances: Sequence[float], bound: float) -> float:
    """Compute the mean tolerance of distances; 0 without any."""
    # Called every control step with few distances: plain numbers are faster than NumPy.
    values = [tolerance(distance, bound, 10 * bound) for distance in distances]
    return sum(values) / len(values) if values else 0.0


# The pedal and its goal are each 0 or 1, so their difference has three values.
_SUSTAIN = {d: tolerance(d, _KEY_TOLERANCE, 10 * _KEY_TOLERANCE) for d in (-1, 0, 1)}


def held(missing: Sequence[float]) -> float:
    """Compute the mean closeness of keys to being down from their missing shares of travel."""
    return _mean_closeness(missing, _KEY_TOLERANCE)


def sustain(due: bool, pressed: bool) -> float:
    """Return 1 if the pedal is held when it is due and released when it is not, else nearly 0."""
    return _SUSTAIN[due - pressed]


def labelled_fingering(distances: Sequence[float]) -> float:
    """Compute the mean closeness of labelled fingers, in [0, 1]; 0 if no labelled note is due.

    Args:
        distances: For each labelled due note, the distance of its finger's tip from the point
            where it should press, m.
    """
    return _mean_closeness(distances, _FINGER_TOLERANCE)


def optimal_transport_fingering(fingertips: FloatArray, press_points: FloatArray) -> float:
    """Reward fingertips near the due keys, in the assignment with the least total distance.

    Source: RP1M (Zhao et al. 2024), for scores without finger labels.

    Args:
        fingertips: (10, 3) positions of all fingertips, m.
        press_points: (n, 3) points where the due keys should be pressed, m.

    Returns:
        The mean closeness of the assigned pairs in [0, 1]; 1 if nothing is due.
    """
    if len(press_points) == 0:
        return 1.0
    from scipy.optimize import linear_sum_assignment  # a 0.4 s import that few pieces need

    offset = fingertips[:, None] - press_points[None]
    distance = np.sqrt(np.einsum("...i,...i->...", offset, offset))
    assigned = distance[linear_sum_assignment(distance)]
    return _mean_closeness(assigned.tolist(), _FINGER_TOLERANCE)
