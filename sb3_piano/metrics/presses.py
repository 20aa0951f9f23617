"""Presses, the unbroken runs of control steps in which a key sounds: times, and wrong presses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.metrics.frames import same_frames

_LEAST_DURATION = 1e-3
"""Least duration of a press, s: a key may go down with the very last physics step."""


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


def press_times(
    presses: Presses,
    changes: IntArray,
    within: BoolArray,
    control_timestep: float,
    n_steps: int,
) -> tuple[FloatArray, FloatArray]:
    """Return the times at which each press began and ended.

    A key is pressed or let go when what it does at the end of a control step differs from the end
    of the step before. The time is that of the physics step since which it has been so: a key that
    bounces within a control step went down when it went down for good.

    Args:
        presses: n presses of the episode so far.
        changes: (m,) control steps of which more is known, ascending. What happened in another one
            is taken to have happened at its end.
        within: (m, p, 88) which keys sounded after each of their p physics steps.
        control_timestep: Length of a control step, s.
        n_steps: How many control steps the episode has had.

    Returns:
        (n,) times from the start of the episode, s, at which the keys went down, and at which they
        came up; the end of the last step for those that have not.
    """
    steps = np.concatenate([presses.first, presses.end])
    share = step_shares(steps, np.tile(presses.key, 2), changes, within)
    strikes, releases = np.split((steps + share) * control_timestep, 2)
    end = np.maximum(n_steps * control_timestep, strikes + _LEAST_DURATION)
    return strikes, np.where(presses.end < n_steps, releases, end)


def strike_speeds(angles: FloatArray, within: BoolArray) -> FloatArray:
    """Return by how much keys moved in the physics step in which they went down for good.

    Args:
        angles: (m, p + 1, 88) angles before m control steps and after their p physics steps, rad.
        within: (m, p, 88) which keys sounded after each of these.

    Returns:
        (m, 88) rad in a physics step; 0 of a key that does not sound at the end.
    """
    first = (within.shape[1] - _held(within))[:, None]
    moved = np.take_along_axis(np.diff(angles, axis=1), first, axis=1)[:, 0]
    return np.where(within[:, -1], moved, 0.0)


def _held(states: BoolArray) -> IntArray:
    """Return for how many physics steps at the end, along axis 1, keys were as they are last."""
    other = (states != states[:, -1:])[:, ::-1]
    return np.where(other.any(axis=1), other.argmax(axis=1), states.shape[1])


def step_shares(
    steps: IntArray,
    keys: IntArray,
    changes: IntArray,
    within: BoolArray,
) -> FloatArray:
    """Return after which share of a step keys did for good what they do at its end."""
    share = np.ones(len(steps))
    if len(changes) == 0:
        return share
    row = np.minimum(np.searchsorted(changes, steps), len(changes) - 1)
    known = changes[row] == steps
    states, n_substeps = within[row, :, keys], within.shape[1]
    return np.where(known, (n_substeps - _held(states) + 1) / n_substeps, share)
