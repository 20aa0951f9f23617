"""The terms of the reward in the training's log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from sb3_piano.callbacks.episode_info import RETURN_PREFIX, EpisodeInfoCallback


class RewardTermsCallback(EpisodeInfoCallback):
    """Log what each term of the reward contributed to the finished episodes.

    A term's weighted sum over an episode, ``return_<term>`` in ``info``, goes under
    ``reward/<term>``: ``return_key_press`` becomes ``reward/key_press``. Each value is the mean
    over the episodes since the log was last written; environments without such keys log nothing.
    """

    def _keys(self, info: Mapping[str, Any]) -> Iterable[str]:
        return [key for key in info if key.startswith(RETURN_PREFIX)]
