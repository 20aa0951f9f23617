"""The base of all wrappers that change the reward."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, SupportsFloat

import gymnasium as gym

from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.wrappers.piano import piano_of

RewardTerms = Mapping[str, float]


class RewardTermsWrapper(gym.Wrapper[Any, Any, Any, Any]):
    """Change the weights of the reward's terms, or the terms themselves.

    The reward is the sum of ``weight * term``; ``info["reward_terms"]`` has the terms as they are
    after this wrapper. Several of these wrappers work together: each changes what those inside it
    have left. Metrics and ``return_<term>`` in the final ``info`` stay those of the environment's
    own reward, so that trainings under different rewards can be compared.

    Wrappers of other kinds that change the reward belong outside of these.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._piano = piano_of(env, type(self).__name__)

    @property
    def inner_weights(self) -> Mapping[str, float]:
        """The weights of the terms as they are inside of this wrapper."""
        for inside in self.inner_wrappers():
            return inside.reward_weights
        return self._piano.config.reward_weights

    @property
    def reward_weights(self) -> Mapping[str, float]:
        """The weights of the terms in the control step that was played last."""
        return self.inner_weights

    def inner_wrappers(self) -> Iterator[RewardTermsWrapper]:
        """Return the wrappers of this kind inside of this one, the outermost first."""
        return (layer for layer in layers(self.env) if isinstance(layer, RewardTermsWrapper))

    def reward_terms(self, terms: RewardTerms) -> RewardTerms:
        """Return the terms of the control step that was just played, changed."""
        return terms

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step.

        Raises:
            ConfigError: If a wrapper inside has changed the reward in a way unknown here.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._check(float(reward), weighted_sum(self.inner_weights, info["reward_terms"]))
        terms = self.reward_terms(info["reward_terms"])
        new_reward = weighted_sum(self.reward_weights, terms)
        return observation, new_reward, terminated, truncated, {**info, "reward_terms": terms}

    def _check(self, reward: float, expected: float) -> None:
        if not math.isclose(reward, expected, rel_tol=1e-9, abs_tol=1e-9):
            raise ConfigError(
                f"{type(self).__name__} got the reward {reward:g}, but the weighted terms sum up "
                f"to {expected:g}: a wrapper inside has changed it. Expected that wrapper outside."
            )


def weighted_sum(weights: Mapping[str, float], terms: RewardTerms) -> float:
    """Return the reward."""
    return sum(weights[name] * term for name, term in terms.items())
