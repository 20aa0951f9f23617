"""Presses, the unbroken runs of control steps in which a key sounds, and wrong presses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics.frames import same_frames


class Presses(NamedTuple):
    """n presses, ordered by their first step, then by key."""

    key: npt.NDArray[np.intp]
    """(n,) key, 0-87."""
    first: npt.NDArray[np.intp]
    """(n,) first control step in which the key sounds."""
    end: npt.NDArray[np.intp]
    """(n,) control step after the last one in which it sounds, up to T."""


def presses_of(active: npt.ArrayLike) -> Presses:
    """Find the presses: for each key the unbroken runs of control steps in which it sounds.

    A key that is struck again without falling silent for at least one step stays one press. The
    order is that of ``np.argwhere`` of the first steps, and so of ``PianoRoll.onset``.

    Args:
        active: (T, n) bool, whether each key sounds in each control step.

    Returns:
        The presses; empty arrays if no key ever sounds.

    Raises:
        ValueError: If the array is not two-dimensional.
    """
    active = np.asarray(active, dtype=bool)
    if active.ndim != 2:
        raise ValueError(f"Presses are found in a (steps, keys) array, got shape {active.shape}.")
    steps, keys = active.shape
    # All keys one after the other in one line, each between silent steps, so that no run goes over
    # from one key to the next; rises and falls then take turns.
    line = np.zeros(1 + keys * (steps + 1), dtype=bool)
    line[1:].reshape(keys, steps + 1)[:, :steps] = active.T
    edges = np.flatnonzero(line[1:] != line[:-1])
    key, first = np.divmod(edges[::2], steps + 1)
    end = edges[1::2] - key * (steps + 1)
    order = np.lexsort((key, first))
    return Presses(key=key[order], first=first[order], end=end[order])


def wrong_presses(target: npt.ArrayLike, played: npt.ArrayLike) -> int:
    """Count the presses whose key is due in none of their control steps.

    A press (see :func:`~sb3_piano.metrics.presses_of`) that overlaps a note of its key by one step
    is not wrong, however early or late: the onset scores measure that.

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
    """Return the :func:`wrong_presses` a second of playing; 0.0 without steps.

    ``control_timestep`` is the length of a control step, in s.
    """
    wrong = wrong_presses(target, played)
    return wrong / (len(np.asarray(target)) * control_timestep) if wrong else 0.0
