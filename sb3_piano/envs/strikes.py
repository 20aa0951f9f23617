"""Strikes and the notes that they hit, told as an episode goes on."""

from __future__ import annotations

import copy

from sb3_piano.metrics.onsets import ONSET_TICKS_PER_S, ONSET_TOLERANCE
from sb3_piano.music import PianoRoll


class OpenOnsets:
    """The onsets of a piece that no strike has hit yet.

    The onset metric pairs strikes and onsets when all strikes are known
    (:func:`~sb3_piano.metrics.match_onsets`); here each strike takes the nearest onset that is
    left. The two differ only where strikes of one key are closer than twice the tolerance.
    """

    def __init__(self, roll: PianoRoll) -> None:
        self._times: dict[int, list[float]] = {}  # by key, s
        for _, key, time in roll.strikes():
            self._times.setdefault(key, []).append(time)

    def copy(self) -> OpenOnsets:
        """Return the same onsets, to go on from here independently."""
        copied = copy.copy(self)
        copied._times = {key: list(times) for key, times in self._times.items()}
        return copied

    def hit_within(self, key: int, earliest: float, latest: float) -> bool | None:
        """Return :meth:`hit` of a strike from ``earliest`` to ``latest``, s, if all have the same.

        ``None``, and nothing is hit, if it takes the very time to tell.
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
        """Return whether a strike (0 to 87; s) is in time for a note that was open until now."""
        times = self._times.get(key, [])
        near = [onset for onset in times if _in_time(onset, time)]
        if near:
            times.remove(min(near, key=lambda onset: abs(onset - time)))
        return bool(near)


def _in_time(onset: float, time: float) -> bool:
    return round(abs(onset - time) * ONSET_TICKS_PER_S) / ONSET_TICKS_PER_S <= ONSET_TOLERANCE
