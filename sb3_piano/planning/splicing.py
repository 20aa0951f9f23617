"""Splicing of the better parts of two motions through a piece."""

from __future__ import annotations

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.planning.roll_outs import Way

_CHANGE = 2.0
"""Cost of changing from one motion to the other, per mean square of their distance there."""


def spliced(
    ways: tuple[Way, Way], cost: tuple[FloatArray, FloatArray], deviation: FloatArray
) -> Way:
    """Splice two motions, hand by hand, from their parts of least cost.

    Each hand changes from one motion to the other where they are near, by dynamic programming over
    the control steps. After a change it has to catch up, so the result must be simulated.

    Args:
        ways: The two motions, of T control steps and n actuators.
        cost: (T, h) cost of each of h hands in each control step, for each motion.
        deviation: (n,) unit of distances for each actuator, rad or m.
    """
    n_hands = cost[0].shape[1]
    parts: list[Way] = []
    hands = zip(
        *(np.split(array, n_hands, axis=1) for way in ways for array in way),
        np.split(deviation, n_hands),
        strict=True,
    )
    for hand, (commands, positions, other_commands, other_positions, unit) in enumerate(hands):
        apart = (np.square((positions - other_positions) / unit)).mean(axis=1)
        both = np.stack([cost[0][:, hand], cost[1][:, hand]], axis=1)
        second = _cheapest(both, _CHANGE * apart)[:, None] == 1
        parts.append(
            Way(
                np.where(second, other_commands, commands),
                np.where(second, other_positions, positions),
            )
        )
    return Way(*(np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True)))


def _cheapest(cost: FloatArray, change: FloatArray) -> IntArray:
    """Choose one of two motions for each step, (T,), 0 or 1.

    ``cost`` is (T, 2); ``change``, (T,), is the cost of a change before each step.
    """
    least = np.zeros_like(cost)
    came = np.zeros(cost.shape, dtype=int)
    least[0] = cost[0]
    for step in range(1, len(cost)):
        for way in (0, 1):
            stay, come = least[step - 1, way], least[step - 1, 1 - way] + change[step]
            came[step, way] = way if stay <= come else 1 - way
            least[step, way] = min(stay, come) + cost[step, way]
    taken = np.zeros(len(cost), dtype=int)
    taken[-1] = int(least[-1].argmin())
    for step in range(len(cost) - 1, 0, -1):
        taken[step - 1] = came[step, taken[step]]
    return taken
