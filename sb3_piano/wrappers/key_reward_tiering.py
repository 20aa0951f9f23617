"""RoboVirtuoso's key reward, in which not playing earns nothing where something is due."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from sb3_piano.exceptions import ConfigError
from sb3_piano.wrappers.reward_wrapper import RewardTerms, RewardTermsWrapper


class KeyRewardTiering(RewardTermsWrapper, gym.utils.RecordConstructorArgs):
    """Cap the precision part of ``key_press`` by its recall part.

    Half of ``key_press`` is recall, how far down the due keys are, and half precision, earned whole
    if no wrong key sounds. Hands that press nothing thus earn half of it in every control step.
    Here, in control steps with a due key, precision counts no more than recall does, so that they
    earn nothing. Where nothing is due the term stays as it is.

    Source: RoboVirtuoso, section 6, "Key Reward Tiering". Its formula has the maximum of both
    parts, under which hands that press nothing would keep their half. Its words ("the precision
    reward is capped to the level of the recall reward") and its results, hands that no longer
    hover, say minimum, and that is what this is. The report counts keys for recall, where the term
    here is RoboPianist's, graded by how far down each due key is: both agree for keys that are
    down, and to 0.0003 for keys that are up.

    Args:
        env: A piano environment, wrapped or not.

    Raises:
        ConfigError: If ``env`` is no piano, or has this wrapper already.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        if any(isinstance(layer, KeyRewardTiering) for layer in self.inner_wrappers()):
            raise ConfigError(
                "KeyRewardTiering wraps another one, which has changed the term it goes by: "
                "expected one of them."
            )

    def reward_terms(self, terms: RewardTerms) -> RewardTerms:
        """Return the terms with ``key_press`` tiered."""
        due = self._piano.roll.active[self._piano.steps_played - 1]
        precision = 0.0 if np.any(self._piano.key_active > due) else 1.0
        recall = 2.0 * (terms["key_press"] - 0.5 * precision)
        tiered = tiered_key_press(recall, precision, any_due=bool(due.any()))
        return {**terms, "key_press": tiered}


def tiered_key_press(recall: float, precision: float, *, any_due: bool) -> float:
    """Return the term ``key_press`` under RoboVirtuoso's rule.

    Args:
        recall: How well the due keys are down, in [0, 1]; 0 if none is due.
        precision: 1 if no wrong key sounds, else 0.
        any_due: Whether a key is due.

    Returns:
        A value in [0, 1]; 0.5 for silence where nothing is due, 0 for silence where a key is.
    """
    if any_due:
        precision = min(recall, precision)
    return 0.5 * recall + 0.5 * precision
