"""Wrong presses: keys that were struck though nothing was due on them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics.frames import same_frames
from sb3_piano.metrics.presses import presses_of


def wrong_presses(target: npt.ArrayLike, played: npt.ArrayLike) -> int:
    """Count the presses in none of whose control steps the key is due.

    A press (see :func:`~sb3_piano.metrics.presses_of`) that overlaps a note of its key by one step
    is not wrong, however early or late it is: the onset scores tell that.

    Args:
        target: (T, n) bool, what should sound.
        played: (T, n) bool, what does sound.

    Raises:
        ValueError: If the shapes differ or are not two-dimensional.
    """
    target, played = same_frames(target, played)
    presses = presses_of(played)
    # Keys one after the other in one line: the hits of a press are those between its two ends.
    hits = np.flatnonzero((target & played).T)
    line = presses.key * len(target)
    before, until = np.searchsorted(hits, (line + presses.first, line + presses.end))
    return int(np.count_nonzero(before == until))


def wrong_presses_per_second(
    target: npt.ArrayLike, played: npt.ArrayLike, control_timestep: float
) -> float:
    """Return the :func:`wrong_presses` in each second of playing; 0.0 if there is no step at all.

    Args:
        target: (T, n) bool, what should sound.
        played: (T, n) bool, what does sound.
        control_timestep: Length of a control step, in s.

    Raises:
        ValueError: If the shapes differ or are not two-dimensional.
    """
    wrong = wrong_presses(target, played)
    return wrong / (len(np.asarray(target)) * control_timestep) if wrong else 0.0
