"""Music metrics and reward terms in the training's log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.metrics import EPISODE_METRICS

_RETURN_PREFIX = "return_"


class EpisodeMetricsCallback(BaseCallback):
    """Log what piano environments tell about a finished episode.

    The metrics of :data:`~sb3_piano.metrics.EPISODE_METRICS` go under ``music/`` (``music/f1``),
    the episode's sums of weighted reward terms under ``reward/`` (``return_energy`` becomes
    ``reward/energy``). Each logged value is the mean over the episodes that finished, in all
    environments, since the log was last written. Environments without these keys log nothing.

    The values are recorded while SB3 collects a rollout, before it writes the log: off-policy
    algorithms write it within the step that ends an episode, so that a value recorded at the end of
    the rollout would come one log line late.

    Args:
        keys: Names in ``info`` to log. By default the music metrics and every number called
            ``return_*``.
    """

    def __init__(self, keys: Iterable[str] | None = None) -> None:
        super().__init__()
        self._keys = None if keys is None else tuple(keys)

    def _on_step(self) -> bool:
        for done, info in zip(self.locals["dones"], self.locals["infos"], strict=True):
            if done:
                self._record(info)
        return True

    def _record(self, info: Mapping[str, Any]) -> None:
        for key in self._default_keys(info) if self._keys is None else self._keys:
            if key in info:
                self.logger.record_mean(log_name(key), float(info[key]))

    @staticmethod
    def _default_keys(info: Mapping[str, Any]) -> tuple[str, ...]:
        returns = (
            key
            for key, value in info.items()
            if key.startswith(_RETURN_PREFIX) and isinstance(value, (int, float, np.number))
        )
        return (*EPISODE_METRICS, *returns)


def log_name(key: str) -> str:
    """Return the name under which a key of ``info`` is logged.

    >>> log_name("f1"), log_name("return_key_press")
    ('music/f1', 'reward/key_press')
    """
    if key.startswith(_RETURN_PREFIX):
        return f"reward/{key.removeprefix(_RETURN_PREFIX)}"
    return f"music/{key}"
