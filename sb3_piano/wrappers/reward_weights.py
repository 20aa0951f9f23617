"""Other weights of the reward's terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS
from sb3_piano.envs.config import RewardWeight
from sb3_piano.settings import checked, refuse_unknown
from sb3_piano.wrappers.reward_wrapper import RewardTermsWrapper


class RewardWeights(RewardTermsWrapper, gym.utils.RecordConstructorArgs):
    """Weight terms of the reward in another way.

    The rewards are exactly those of an environment that is made with ``reward_weights``. Other than
    that, it leaves the metrics ``return_<term>`` and ``normalized_return`` as they were. A
    :class:`~sb3_piano.wrappers.FingeringDecay` belongs outside of a ``RewardWeights`` with
    ``fingering``, which would otherwise overrule it.

    Args:
        env: A piano environment, wrapped or not.
        weights: Weight by name of the term, one of ``sb3_piano.envs.DEFAULT_REWARD_WEIGHTS``, each
            a finite number; terms without one keep the weight they have. ``energy`` is per watt.

    Raises:
        ConfigError: If a name is unknown, a weight is no finite number, or ``env`` is no piano.
    """

    def __init__(self, env: gym.Env[Any, Any], weights: Mapping[str, float]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, weights=weights)
        super().__init__(env)
        self._weights = checked("weights", weights, Mapping[str, RewardWeight])
        refuse_unknown(weights, DEFAULT_REWARD_WEIGHTS, "reward term")

    @property
    def reward_weights(self) -> Mapping[str, float]:
        """The weights of the terms."""
        return {**self.inner_weights, **self._weights}
