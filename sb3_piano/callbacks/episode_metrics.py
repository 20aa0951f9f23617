"""Music metrics and reward terms of finished episodes in the training's log."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.metrics.episode import RETURN_PREFIX

PRINTED = ("f1", "onset_f1", "noop_f1", "wrong_presses_per_second")
"""Metrics that the console shows. The others are in TensorBoard, CSV and JSON alone, as thirty rows
would hide these."""

NOT_PRINTED = tuple(name for name in EPISODE_METRICS if name not in PRINTED)
"""Metrics that the console does not show."""

_GROUPS = {RETURN_PREFIX: "reward", "finger_share_": "fingers"}


class EpisodeInfoCallback(BaseCallback):
    """Log numbers from the final ``info`` of each episode.

    Each logged value is the mean over the episodes of all environments since the last log line.
    Missing keys and values that are not finite are left out.

    The values are recorded while SB3 collects a rollout, before it writes the log: off-policy
    algorithms write it within the step that ends an episode, so that a value recorded at the end of
    the rollout would come one log line late.
    """

    @abstractmethod
    def _keys(self, info: Mapping[str, Any]) -> Iterable[str]:
        """Return the keys to log from an episode's final ``info``."""

    def _on_step(self) -> bool:
        for done, info in zip(self.locals["dones"], self.locals["infos"], strict=True):
            for key in self._keys(info) if done else ():
                number = finite_number(info.get(key))
                if number is not None:
                    self.logger.record_mean(log_name(key), number, exclude=self._exclude(key))
        return True

    def _exclude(self, key: str) -> str | None:
        """Return the output of SB3's logger that does not get a key."""
        return None


def log_name(key: str) -> str:
    """Return the log name of a key of ``info``.

    >>> log_name("f1"), log_name("return_key_press"), log_name("finger_share_r1")
    ('music/f1', 'reward/key_press', 'fingers/r1')
    """
    for prefix, group in _GROUPS.items():
        if key.startswith(prefix):
            return f"{group}/{key.removeprefix(prefix)}"
    return f"music/{key}"


def finite_number(value: Any) -> float | None:
    """Return a value as a finite number, or ``None`` if it is not one."""
    if not isinstance(value, (int, float, np.number)):
        return None
    number = float(value)
    return number if math.isfinite(number) else None


class EpisodeMetricsCallback(EpisodeInfoCallback):
    """Log the music metrics of finished episodes.

    The metrics of :data:`~sb3_piano.metrics.EPISODE_METRICS` go under ``music/`` (``music/f1``),
    the fingers' shares of the presses under ``fingers/`` (``finger_share_r1``, the right thumb's,
    becomes ``fingers/r1``). Each value is the mean over the episodes since the log was last
    written; environments without these keys log nothing.

    Args:
        keys: Names in ``info`` to log in place of these; the console then shows them all.
    """

    def __init__(self, keys: Iterable[str] = EPISODE_METRICS) -> None:
        super().__init__()
        self._names = tuple(keys)

    def _keys(self, info: Mapping[str, Any]) -> Iterable[str]:
        del info  # those that it lacks are left out anyway
        return self._names

    def _exclude(self, key: str) -> str | None:
        return "stdout" if self._names == EPISODE_METRICS and key in NOT_PRINTED else None


class RewardTermsCallback(EpisodeInfoCallback):
    """Log the contribution of each reward term to finished episodes.

    A term's weighted sum over an episode, ``return_<term>`` in ``info``, goes under
    ``reward/<term>``: ``return_key_press`` becomes ``reward/key_press``. Each value is the mean
    over the episodes since the log was last written; environments without such keys log nothing.
    """

    def _keys(self, info: Mapping[str, Any]) -> Iterable[str]:
        return [key for key in info if key.startswith(RETURN_PREFIX)]
