"""Matching of strikes to notes during an episode."""

from __future__ import annotations

import copy

from sb3_piano.metrics.onsets import ONSET_TICKS_PER_S, ONSET_TOLERANCE
from sb3_piano.music import PianoRoll


class OpenOnsets:
    """Onsets of a piece that no strike has hit yet.

    The onset metric pairs strikes and onsets when all strikes are known
    (:func:`~sb3_piano.metrics.match_onsets`). Here each strike takes the nearest open onset. The
    two differ only if strikes of one key are closer than twice the tolerance.
    """

    def __init__(self, roll: PianoRoll) -> None:
        self._times: dict[int, list[float]] = {}  # by key, s
        for _, key, time in roll.strikes():
            self._times.setdefault(key, []).append(time)

    def copy(self) -> OpenOnsets:
        """Return an independent copy."""
        copied = copy.copy(self)
        copied._times = {key: list(times) for key, times in self._times.items()}
        return copied

    def hit_within(self, key: int, earliest: float, latest: float) -> bool | None:
        """Return :meth:`hit` of a strike from ``earliest`` to ``latest``, s, if no time changes it.

        If the result depends on the exact time, return ``None`` and hit nothing.
        """
        times = self._times.get(key, [])
        near = [onset for onset in times if _in_time(onset, min(max(onset, earliest), latest))]
        if not near:
            return False
        if len(near) > 1 or not (_in_time(near[0], earliest) and _in_time(near[0], latest)):
            return None
        times.remove(near[0])
        return True

    def hit(self, key: int, time: float) -> bool:
        """Match a strike (key 0 to 87; s) to an open onset; return whether one is in time."""
        times = self._times.get(key, [])
        near = [onset for onset in times if _in_time(onset, time)]
        if near:
            times.remove(min(near, key=lambda onset: abs(onset - time)))
        return bool(near)


def _in_time(onset: float, time: float) -> bool:
    return round(abs(onset - time) * ONSET_TICKS_PER_S) / ONSET_TICKS_PER_S <= ONSET_TOLERANCE
