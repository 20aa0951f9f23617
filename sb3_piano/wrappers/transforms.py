"""Wrappers that shift pieces along the keyboard or stretch them in time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import gymnasium as gym
import numpy as np

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import MAX_PITCH, MIN_PITCH, Score
from sb3_piano.settings import Positive, Whole, checked
from sb3_piano.wrappers.score_wrapper import ScoreChange, possible_scores


class KeyShift(ScoreChange):
    """Shift each piece by steps of some semitones: a fixed number, or one drawn from a pair."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        name: str,
        steps: Any,
        probability: float,
        *,
        semitones: int,
    ) -> None:
        super().__init__(env, probability)
        self._lowest, self._highest, self._is_drawn = _ends(name, steps, Whole)
        self._semitones = semitones
        possible_scores(self)  # raises if a piece cannot be shifted

    def draw(self, score: Score, random: np.random.Generator) -> int:
        """Return the shift of this episode, in semitones."""
        if not self._is_drawn:
            return self._lowest * self._semitones
        down, up = _room(score)
        first, last = -(-down // self._semitones), up // self._semitones
        low, high = _clamp(self._lowest, first, last), _clamp(self._highest, first, last)
        return int(random.integers(low, high, endpoint=True)) * self._semitones

    def extreme_values(self, score: Score) -> list[int]:
        """Return the lowest and the highest shift, in semitones."""
        lowest, highest = self._lowest * self._semitones, self._highest * self._semitones
        if not self._is_drawn:
            return [lowest]
        # Not clamped to whole steps: part of the score may have room for one more of them.
        return [_clamp(lowest, *_room(score)), _clamp(highest, *_room(score))]

    def changed(self, score: Score, value: int) -> Score:
        """Return the score shifted by a number of semitones."""
        return score.transpose(value)


class PitchShift(KeyShift, gym.utils.RecordConstructorArgs):
    """Shift each piece up or down, by whole semitones.

    ``PitchShift(env, 3)`` plays all pieces three semitones higher. ``PitchShift(env, [-2, 2])``
    draws one of the five shifts for each episode, all equally likely. Of a range only those shifts
    are drawn that keep all notes of the piece on the keyboard; if none does, the one that is
    nearest to the range.

    Args:
        env: A piano environment, wrapped or not.
        semitones: The shift, negative for lower; or a pair of the lowest and the highest to draw
            from, both included.
        probability: How likely an episode's piece is shifted at all, 0 to 1.

    Raises:
        ConfigError: If ``semitones`` is neither, ``probability`` is none, or ``env`` is no piano.
        ScoreError: If a fixed shift takes a note off the keyboard, here for the environment's own
            pieces, at ``reset`` for others.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        semitones: int | Sequence[int],
        probability: float = 1.0,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, semitones=semitones, probability=probability)
        super().__init__(env, "semitones", semitones, probability, semitones=1)


def _room(score: Score) -> tuple[int, int]:
    """Return the lowest and the highest shift on the keyboard, semitones."""
    lowest, highest = score.pitch_range
    return MIN_PITCH - lowest, MAX_PITCH - highest


def _clamp(value: int, low: int, high: int) -> int:
    return min(max(value, low), high)


_OCTAVE = 12
"""Semitones."""


class OctaveShift(KeyShift, gym.utils.RecordConstructorArgs):
    """Shift each piece up or down, by whole octaves.

    White keys stay white and black keys black, so that a fingering stays as good as it was. All
    else is as in :class:`~sb3_piano.wrappers.PitchShift`: of a range only those shifts are drawn
    that keep the piece on the keyboard; if none does, the one that is nearest to the range.

    Args:
        env: A piano environment, wrapped or not.
        octaves: The shift, negative for lower; or a pair of the lowest and the highest to draw
            from, both included.
        probability: How likely an episode's piece is shifted at all, 0 to 1.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        octaves: int | Sequence[int],
        probability: float = 1.0,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, octaves=octaves, probability=probability)
        super().__init__(env, "octaves", octaves, probability, semitones=_OCTAVE)


Scale = Literal["logarithmic", "linear"]
"""Scale on which a drawn factor is uniform."""


class TemporalStretch(ScoreChange, gym.utils.RecordConstructorArgs):
    """Play each piece slower or faster.

    ``TemporalStretch(env, 2.0)`` makes all pieces twice as long, and with them the episodes.
    ``TemporalStretch(env, [0.5, 2.0])`` draws a factor for each episode, uniformly on a logarithmic
    scale: twice as fast and twice as slow are equally likely. RoboPianist's augmentation, a factor
    that is uniform around 1 and that acts with a probability, is
    ``TemporalStretch(env, [0.9, 1.1], scale="linear", probability=0.5)``.

    Args:
        env: A piano environment, wrapped or not.
        factor: New length over old length, finite and above 0; or a pair of the least and the
            greatest to draw from.
        probability: How likely an episode's piece is stretched at all, 0 to 1.
        scale: On which scale a drawn factor is uniform, "logarithmic" or "linear".

    Raises:
        ConfigError: If an argument is none of these, or ``env`` is no piano.
        ScoreError: If the factor leaves a note without length, here for the environment's own
            pieces, at ``reset`` for others.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        factor: float | Sequence[float],
        probability: float = 1.0,
        scale: Scale = "logarithmic",
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self, factor=factor, probability=probability, scale=scale
        )
        super().__init__(env, probability)
        self._is_linear = checked("scale", scale, Scale) == "linear"
        self._least, self._greatest, self._is_drawn = _ends("factor", factor, Positive)
        self.draws_times = self._is_drawn or 0 < self._probability < 1
        possible_scores(self)  # raises if a piece cannot be stretched

    def draw(self, score: Score, random: np.random.Generator) -> float:
        """Return the factor of this episode."""
        low, high = self._least, self._greatest
        if not self._is_drawn:
            return low
        if self._is_linear:
            return random.uniform(low, high)
        drawn = math.exp(random.uniform(math.log(low), math.log(high)))
        return min(max(drawn, low), high)  # rounding may lead beyond the ends

    def extreme_values(self, score: Score) -> list[float]:
        """Return the least and the greatest factor."""
        return [self._least, self._greatest]

    def changed(self, score: Score, value: float) -> Score:
        """Return the score stretched by a factor."""
        return score.stretch(value)


def _ends(name: str, value: Any, kind: Any) -> tuple[Any, Any, bool]:
    """Return the ends of an argument's range, and whether a value is drawn."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        only = checked(name, value, kind)
        return only, only, False
    if len(value) != 2:
        raise ConfigError(
            f"{name} is {value!r}: expected one number, or a pair of the lowest and the highest."
        )
    low, high = (checked(f"{name}[{i}]", value[i], kind) for i in (0, 1))
    if low > high:
        raise ConfigError(f"{name} is {value!r}: expected the lower end first.")
    return low, high, True
