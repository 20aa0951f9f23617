"""Music metrics in the training's log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from sb3_piano.callbacks.episode_info import EpisodeInfoCallback
from sb3_piano.metrics import EPISODE_METRICS


class EpisodeMetricsCallback(EpisodeInfoCallback):
    """Log how well the finished episodes were played.

    The metrics of :data:`~sb3_piano.metrics.EPISODE_METRICS` go under ``music/`` (``music/f1``),
    the fingers' shares of the presses under ``fingers/`` (``finger_share_r1``, the right thumb's,
    becomes ``fingers/r1``). Each value is the mean over the episodes since the log was last
    written; environments without these keys log nothing.

    Args:
        keys: Names in ``info`` to log in place of these.
    """

    def __init__(self, keys: Iterable[str] = EPISODE_METRICS) -> None:
        super().__init__()
        self._names = tuple(keys)

    def _keys(self, info: Mapping[str, Any]) -> Iterable[str]:
        del info  # those that it lacks are left out anyway
        return self._names
