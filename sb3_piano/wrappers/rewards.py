"""Wrappers that change the weights or the terms of the reward."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np

from sb3_piano.envs.terms import RewardWeight
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.settings import Count, Index, Share, checked, refuse_unknown
from sb3_piano.wrappers.piano import unwrap_piano

RewardTerms = Mapping[str, float]


class RewardTermsWrapper(gym.Wrapper[Any, Any, Any, Any]):
    """Base of wrappers that change reward weights or reward terms.

    The reward is the sum of ``weight * term``; ``info["reward_terms"]`` has the terms as they are
    after this wrapper. Several of these wrappers work together: each changes what those inside it
    have left. Metrics and ``return_<term>`` in the final ``info`` stay those of the environment's
    own reward, so that trainings under different rewards can be compared.

    Wrappers of other kinds that change the reward belong outside of these.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._piano = unwrap_piano(env, type(self).__name__)

    @property
    def inner_weights(self) -> Mapping[str, float]:
        """Weights of the terms inside this wrapper."""
        for inside in self.inner_wrappers():
            return inside.reward_weights
        return self._piano.config.reward_weights

    @property
    def reward_weights(self) -> Mapping[str, float]:
        """Weights of the terms in the last control step."""
        return self.inner_weights

    def inner_wrappers(self) -> Iterator[RewardTermsWrapper]:
        """Return the wrappers of this kind inside this one, the outermost first."""
        return (layer for layer in layers(self.env) if isinstance(layer, RewardTermsWrapper))

    def reward_terms(self, terms: RewardTerms) -> RewardTerms:
        """Return the changed terms of the last control step."""
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
        info["reward_terms"] = terms
        return observation, new_reward, terminated, truncated, info

    def _check(self, reward: float, expected: float) -> None:
        if not math.isclose(reward, expected, rel_tol=1e-9, abs_tol=1e-9):
            raise ConfigError(
                f"{type(self).__name__} got the reward {reward:g}, but the weighted terms sum up "
                f"to {expected:g}: a wrapper inside has changed it. Expected that wrapper outside."
            )


def weighted_sum(weights: Mapping[str, float], terms: RewardTerms) -> float:
    """Return the reward."""
    return sum(weights[name] * term for name, term in terms.items())


class RewardWeights(RewardTermsWrapper, gym.utils.RecordConstructorArgs):
    """Set weights of reward terms by name.

    The rewards equal those of an environment made with ``reward_weights``; unlike there, the
    metrics ``return_<term>`` and ``normalized_return`` stay unchanged. Put a
    :class:`~sb3_piano.wrappers.FingeringDecay` outside of a ``RewardWeights`` with ``fingering``,
    which would otherwise overrule it.

    Args:
        env: A piano environment, wrapped or not.
        weights: Weight by name of the term, one that the environment has, each a finite number;
            terms without one keep the weight they have. ``energy`` is per watt.

    Raises:
        ConfigError: If a name is unknown, a weight is no finite number, or ``env`` is no piano.
    """

    def __init__(self, env: gym.Env[Any, Any], weights: Mapping[str, float]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, weights=weights)
        super().__init__(env)
        self._weights = checked("weights", weights, Mapping[str, RewardWeight])
        known = unwrap_piano(env, "RewardWeights").config.reward_weights
        refuse_unknown(weights, known, "reward term")

    @property
    def reward_weights(self) -> Mapping[str, float]:
        """Weights of the terms."""
        return {**self.inner_weights, **self._weights}


class FingeringDecay(RewardTermsWrapper, gym.utils.RecordConstructorArgs):
    """Lower the weight of the fingering term during the training.

    The weight falls linearly from its value inside this wrapper, in control step ``start``, to
    ``final``, ``n_steps`` control steps later, and stays there. Labels guide fingers to their keys
    at first; later the policy may find better fingers.

    Steps are those of this environment, counted by ``env.unwrapped.total_steps``, also over
    episodes. Of several environments each counts its own: for a decay over N steps of a training
    with 4 environments, ``n_steps`` is N / 4. A training that ``sb3-piano train --resume`` goes on
    with counts on; evaluations report the environment's own reward, which does not change.

    Args:
        env: A piano environment, wrapped or not.
        n_steps: Control steps of this environment from the first weight to the last, at least 1.
        final: Weight at the end.
        start: Control steps before the weight begins to fall, at least 0.

    Raises:
        ConfigError: If an argument is out of range, or ``env`` is no piano or has no hands.
    """

    def __init__(
        self, env: gym.Env[Any, Any], n_steps: int, *, final: float = 0.0, start: int = 0
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, n_steps=n_steps, final=final, start=start)
        super().__init__(env)
        self._n_steps = checked("n_steps", n_steps, Count)
        self._final = checked("final", final, RewardWeight)
        self._start = checked("start", start, Index)
        refuse_unknown(["fingering"], self.inner_weights, "reward term")

    @property
    def reward_weights(self) -> Mapping[str, float]:
        """Weights of the terms in the last control step."""
        weights = self.inner_weights
        share = min(max((self._piano.total_steps - self._start) / self._n_steps, 0.0), 1.0)
        fingering = (1.0 - share) * weights["fingering"] + share * self._final
        return {**weights, "fingering": fingering}


TIERED_TERMS = ("energy", "forearm")
"""Terms that count only while the keys are pressed well."""


class RewardTiering(RewardTermsWrapper, gym.utils.RecordConstructorArgs):
    """Count energy and forearms only in control steps with well pressed keys.

    While ``key_press`` is not above the threshold, the terms ``energy`` and ``forearm`` are 0.
    ``key_press`` is taken as it arrives: with a :class:`~sb3_piano.wrappers.KeyRewardTiering`
    inside it is the tiered one.

    Source: RoboVirtuoso, section 6, "reward tiering". It gives no number; the default is that of
    its authors' code. In steps in which nothing is due ``key_press`` is 0.5 at most, so that they
    never have these terms. Where a key is due, hands that press nothing are just above it, since a
    key that is up counts 0.00025 of one that is down; 0.75 asks for half of the recall, and inside
    a ``RewardTiering`` a ``KeyRewardTiering`` lets nothing count that is not played.

    Args:
        env: A piano environment, wrapped or not.
        threshold: Lower bound of ``key_press`` for the terms to count, in [0, 1].

    Raises:
        ConfigError: If ``threshold`` is out of range, or ``env`` is no piano or has no hands.
    """

    def __init__(self, env: gym.Env[Any, Any], threshold: float = 0.5) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, threshold=threshold)
        super().__init__(env)
        self._threshold = checked("threshold", threshold, Share)
        refuse_unknown(TIERED_TERMS, self.inner_weights, "reward term")

    def reward_terms(self, terms: RewardTerms) -> RewardTerms:
        """Return the terms, with 0 for unearned terms."""
        if terms["key_press"] > self._threshold:
            return terms
        return {**terms, **dict.fromkeys(TIERED_TERMS, 0.0)}


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

    Raises:
        ConfigError: If ``env`` is no piano, or has this wrapper already.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        if any(isinstance(layer, KeyRewardTiering) for layer in self.inner_wrappers()):
            raise ConfigError(
                "KeyRewardTiering wraps another one, which has already tiered key_press: expected "
                "only one of them."
            )

    def reward_terms(self, terms: RewardTerms) -> RewardTerms:
        """Return the terms with ``key_press`` tiered."""
        due = self._piano.asked_roll.active[self._piano.steps_played - 1]
        precision = 0.0 if np.any(self._piano.key_active > due) else 1.0
        recall = 2.0 * (terms["key_press"] - 0.5 * precision)
        if due.any():
            precision = min(recall, precision)
        return {**terms, "key_press": 0.5 * recall + 0.5 * precision}
