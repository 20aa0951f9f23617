"""Pieces played slower or faster."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_piano.music import Score
from sb3_piano.settings import Positive
from sb3_piano.wrappers.score_change import FixedOrRange, ScoreChange
from sb3_piano.wrappers.score_wrapper import possible_scores


class TemporalStretch(ScoreChange, gym.utils.RecordConstructorArgs):
    """Play each piece slower or faster.

    ``TemporalStretch(env, 2.0)`` makes all pieces twice as long, and with them the episodes.
    ``TemporalStretch(env, [0.5, 2.0])`` draws a factor for each episode, uniformly on a logarithmic
    scale: twice as fast and twice as slow are equally likely.

    Args:
        env: A piano environment, wrapped or not.
        factor: New length over old length, finite and above 0; or a pair of the least and the
            greatest to draw from.

    Raises:
        ConfigError: If ``factor`` is neither, or ``env`` is no piano.
        ScoreError: If the factor leaves a note without length, here for the environment's own
            pieces, at ``reset`` for others.
    """

    def __init__(self, env: gym.Env[Any, Any], factor: float | Sequence[float]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, factor=factor)
        super().__init__(env)
        self._factor = FixedOrRange.of("factor", factor, Positive)
        possible_scores(self)  # raises if a piece cannot be stretched

    @property
    def draws_times(self) -> bool:
        """Whether the factor is drawn."""
        return not self._factor.fixed

    def draw(self, score: Score, random: np.random.Generator) -> float:
        """Return the factor of this episode."""
        low, high = self._factor.low, self._factor.high
        if self._factor.fixed:
            return low
        drawn = math.exp(random.uniform(math.log(low), math.log(high)))
        return min(max(drawn, low), high)  # rounding may lead beyond the ends

    def extreme_values(self, score: Score) -> list[float]:
        """Return the least and the greatest factor."""
        return [self._factor.low, self._factor.high]

    def changed(self, score: Score, value: float) -> Score:
        """Return the score stretched by a factor."""
        return score.stretch(value)
