"""When, within a control step, keys went down and came up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics import presses_of

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]


class PressTimes:
    """Grows by one control step at a time.

    A key is pressed or let go when what it does at the end of a control step differs from the end
    of the step before. The time is that of the physics step since which it has been so: a key that
    bounces within a control step went down when it went down for good.
    """

    def __init__(self, control_timestep: float):
        """Begin without a press.

        Args:
            control_timestep: Length of a control step, s.
        """
        self._control_timestep = control_timestep
        self._strikes: list[float] = []
        self._releases: list[float] = []
        self._held: dict[int, int] = {}  # which press each key that is down belongs to

    def add(self, step: int, key: int, down: Sequence[bool]) -> None:
        """Note down that a key was struck or let go in a control step.

        Args:
            step: The control step; at its end the key does another thing than at its beginning.
            key: The key. Those of one step come in ascending order.
            down: Whether it was down after each of the p physics steps.
        """
        since = len(down) - 1
        while since > 0 and down[since - 1] == down[-1]:
            since -= 1
        time = (step + (since + 1) / len(down)) * self._control_timestep
        if down[-1]:
            self._held[key] = len(self._strikes)
            self._strikes.append(time)
            self._releases.append(np.nan)
        else:
            self._releases[self._held.pop(key)] = time

    def strikes(self) -> FloatArray:
        """Return when each press began, (n,) s, in the order of ``presses_of``."""
        return np.array(self._strikes, dtype=float)

    def releases(self, end: float) -> FloatArray:
        """Return when each press ended, (n,) s.

        Those that have not ended last until ``end``, but at least a millisecond: a key may go down
        with the very last physics step.
        """
        releases = self.unfinished_releases()
        return np.where(np.isnan(releases), np.maximum(end, self.strikes() + 1e-3), releases)

    def unfinished_releases(self) -> FloatArray:
        """Return when each press ended, (n,) s; NaN for those that have not."""
        return np.array(self._releases, dtype=float)

    def restore(self, key_active: BoolArray, strikes: FloatArray, releases: FloatArray) -> None:
        """Go on from the presses of (t, 88) steps with these times."""
        presses = presses_of(key_active)
        held = presses.end == len(key_active)
        self._strikes = strikes.tolist()
        self._releases = np.where(held, np.nan, releases).tolist()
        self._held = {int(presses.key[i]): int(i) for i in np.flatnonzero(held)}
