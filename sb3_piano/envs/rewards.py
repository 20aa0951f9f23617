"""The reward terms: pure functions of arrays, weighted and summed by the environment.

The reward of a control step is the sum over the terms of ``weight * term``. Source of all terms:
RoboPianist (Zakka et al. 2023), its public task ``PianoWithShadowHands``; the optimal-transport
fingering is RP1M's (Zhao et al. 2024). With the default weights each weighted term equals
RoboPianist's own; ``strike``, which RoboPianist does not have, has the weight 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from sb3_piano.arrays import FloatArray

DEFAULT_REWARD_WEIGHTS: Mapping[str, float] = MappingProxyType(
    {"key_press": 1.0, "sustain": 1.0, "energy": 0.005, "fingering": 1.0, "forearm": 0.5}
    | {"strike": 0.0}
)
"""RoboPianist's weights. ``energy`` is per watt, ``strike`` for each strike; the other terms lie in
[0, 1]."""

SELF_ACTUATED_REWARD_WEIGHTS: Mapping[str, float] = MappingProxyType(
    {"distance": 1.0, "log_likelihood": 0.0, "key_press": 0.0, "sustain": 0.0, "strike": 0.0}
)
"""Weights where no hand is in the scene and the keys are driven themselves. ``distance`` is
RoboPianist's default there, ``log_likelihood`` its other choice."""

RETURN_PREFIX = "return_"
"""Beginning of the names in the final ``info`` of the sums of the weighted terms."""

RETURN_KEYS = tuple(RETURN_PREFIX + name for name in DEFAULT_REWARD_WEIGHTS)
"""Names in the final ``info`` of the episode sums of the weighted terms."""

# A key counts as pressed, and a finger as on its key, within these distances; the reward has
# fallen to a tenth at ten times as much beyond.
_KEY_TOLERANCE = 0.05  # share of the key's travel
_FINGER_TOLERANCE = 0.01  # m


def highest_return(
    weights: Mapping[str, float],
    *,
    n_steps: int,
    n_due: int,
    n_fingering: int,
    n_strikes: int,
    forearm: bool,
) -> float:
    """Return the highest return that a piece allows: every term at its upper end in every step.

    No playing reaches it where moving takes energy, which it leaves at 0.

    Args:
        weights: Weight of each term by name; what a negative one would subtract is left at 0.
        n_steps: Control steps of the piece.
        n_due: Those in which a key is due; in the others ``key_press`` is 0.5 at most.
        n_fingering: Those in which ``fingering`` can be earned.
        n_strikes: Strikes that the piece asks for.
        forearm: Whether ``forearm`` can be earned.
    """
    sums = {
        "distance": 0,
        "log_likelihood": 0,
        "key_press": 0.5 * (n_steps + n_due),
        "sustain": n_steps,
        "energy": 0,
        "fingering": n_fingering,
        "forearm": n_steps * forearm,
        "strike": n_strikes,
    }
    return float(sum(max(weight, 0.0) * sums[name] for name, weight in weights.items()))


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


def key_press(keys: Iterable[int], key_state: FloatArray, wrong: bool) -> float:
    """Reward pressing the keys that are due, and no others.

    Half of it is the mean closeness of the due keys to being fully down (0 if none is due), the
    other half is earned whole if no key sounds that is not due.

    Args:
        keys: The keys that should be down.
        key_state: (88,) angle over largest angle, in [0, 1].
        wrong: Whether a key sounds that should not be down.

    Returns:
        A value in [0, 1]; 0.5 for silence where nothing is due.
    """
    reward = 0.0 if wrong else 0.5
    return reward + 0.5 * held([1.0 - key_state.item(key) for key in keys])


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


_LOG_OF_NOTHING = math.log(1e-6)


def distance(mistakes: int) -> float:
    """Return minus the Euclidean distance between what is down and what is due.

    Source: RoboPianist's task ``SelfActuatedPiano``, where keys and pedal are 0 or 1.

    Args:
        mistakes: Keys that sound and should not or the other way round, and the pedal likewise.
    """
    return -math.sqrt(mistakes)


def log_likelihood(mistakes: int) -> float:
    """Return minus the binary cross-entropy between what is down and what is due.

    Source: as of :func:`distance`; where a probability is 0, 1e-6 stands for it.

    Args:
        mistakes: As of :func:`distance`.
    """
    return mistakes * _LOG_OF_NOTHING


def energy(force: FloatArray, velocity: FloatArray) -> float:
    """Return minus the power that the actuators turn over.

    Args:
        force: (nu,) actuator forces, N or N m.
        velocity: (nu,) actuator velocities, m/s or rad/s.

    Returns:
        Minus the sum of ``|force| * |velocity|``, W.
    """
    return -float(np.abs(force).dot(np.abs(velocity)))


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


def strike(hits: int, misses: int) -> float:
    """Return how many strikes of a control step were in time less how many were not.

    Args:
        hits: Strikes within the tolerance of the onset metric of a note not yet struck.
        misses: Strikes of wrong keys, too early, too late, or of a note a second time.
    """
    return float(hits - misses)


def forearm(touching: bool) -> float:
    """Return 1 while the forearms do not touch each other, else 0."""
    return 0.0 if touching else 1.0
