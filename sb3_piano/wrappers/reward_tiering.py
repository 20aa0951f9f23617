"""RoboVirtuoso's reward, in which comfort counts only while keys are pressed well."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from sb3_piano.settings import Share, checked
from sb3_piano.wrappers.reward_wrapper import RewardTerms, RewardTermsWrapper

TIERED_TERMS = ("energy", "forearm")
"""The terms that have to be earned by pressing keys."""


class RewardTiering(RewardTermsWrapper, gym.utils.RecordConstructorArgs):
    """Let energy and forearms count only in control steps in which the keys are pressed well.

    Where ``key_press`` is less than the threshold, the terms ``energy`` and ``forearm`` are 0:
    nothing is earned by forearms that keep apart, and no energy is paid for either. ``key_press``
    is taken as it arrives, so that of a :class:`~sb3_piano.wrappers.KeyRewardTiering` inside it is
    the tiered one.

    Source: RoboVirtuoso, section 6, "reward tiering". It gives no number for the threshold; the
    default asks, where no wrong key sounds, for half of the recall. In steps in which nothing is
    due ``key_press`` is 0.5 at most, so that with a greater threshold they never have these terms.

    Args:
        env: A piano environment, wrapped or not.
        threshold: Least ``key_press`` with which the terms count, in [0, 1].

    Raises:
        ConfigError: If ``threshold`` is out of range, or ``env`` is no piano.
    """

    def __init__(self, env: gym.Env[Any, Any], threshold: float = 0.75) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, threshold=threshold)
        super().__init__(env)
        self._threshold = checked("threshold", threshold, Share)

    def reward_terms(self, terms: RewardTerms) -> RewardTerms:
        """Return the terms, with 0 for those that are not earned."""
        if terms["key_press"] >= self._threshold:
            return terms
        return {**terms, **dict.fromkeys(TIERED_TERMS, 0.0)}
