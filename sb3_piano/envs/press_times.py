"""Times within a control step at which keys went down and came up."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics import Presses

IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]

_LEAST = 1e-3
"""Least duration of a press, s: a key may go down with the very last physics step."""


def press_times(
    presses: Presses,
    changes: IntArray,
    within: BoolArray,
    control_timestep: float,
    n_steps: int,
) -> tuple[FloatArray, FloatArray]:
    """Return when each press began and ended.

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
    share = _shares(steps, np.tile(presses.key, 2), changes, within)
    strikes, releases = np.split((steps + share) * control_timestep, 2)
    end = np.maximum(n_steps * control_timestep, strikes + _LEAST)
    return strikes, np.where(presses.end < n_steps, releases, end)


def _shares(steps: IntArray, keys: IntArray, changes: IntArray, within: BoolArray) -> FloatArray:
    """Return after which share of a step keys did for good what they do at its end."""
    share = np.ones(len(steps))
    if len(changes) == 0:
        return share
    row = np.minimum(np.searchsorted(changes, steps), len(changes) - 1)
    known = changes[row] == steps
    states = within[row, :, keys]
    # Backwards from the end, how far it has been so.
    other = (states != states[:, -1:])[:, ::-1]
    n_substeps = states.shape[1]
    so_long = np.where(other.any(axis=1), other.argmax(axis=1), n_substeps)
    return np.where(known, (n_substeps - so_long + 1) / n_substeps, share)
