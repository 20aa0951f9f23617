"""Settings of predictive sampling."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from sb3_piano.exceptions import ConfigError


@dataclass(frozen=True, kw_only=True)
class SamplingNoise:
    """Random differences of candidates from the best of the last control step.

    The defaults are for sampling around a plan.

    Raises:
        ConfigError: If a value is out of range.
    """

    share: float = 0.4
    """Of the actuators, which a candidate changes; above 0, at most 1."""
    knots: int = 2
    """Points of the horizon at which noise is drawn, the first and the last step included; it is
    linear between them. 1 (constant noise) or more."""
    finger: float = 0.12
    """Standard deviation at a knot, rad, of the fingers' actuators."""
    wrist: float = 0.04
    """That of the wrists' actuators, rad."""
    forearm: float = 0.008
    """That of the sliders on which the forearms stand, m."""
    decay: float = 0.9
    """Share of the last control step's best change that is kept for the next one, in [0, 1]."""

    def __post_init__(self) -> None:
        _check_number("share", self.share, 0 < _real(self.share) <= 1, "above 0, at most 1")
        check_count("knots", self.knots, 1)
        for name in ("finger", "wrist", "forearm"):
            value = getattr(self, name)
            _check_number(name, value, _real(value) >= 0, "0 or more")
        _check_number("decay", self.decay, 0 <= _real(self.decay) <= 1, "0 to 1")


@dataclass(frozen=True, kw_only=True)
class SamplingCost:
    """Weights of a candidate's cost in each control step; less is better.

    Raises:
        ConfigError: If a value is out of range.
    """

    missed: float = 1.0
    """For each key that should sound and does not."""
    wrong: float = 1.5
    """For each key that sounds and should not."""
    reluctant: float = 0.5
    """For each key that should sound, times the share of the way to sounding that is missing."""
    brushed: float = 0.1
    """For each key that should not sound, times the square of the share of the way that it is down
    (at most 1)."""
    astray: float = 0.5
    """Times the mean over the actuators of the squared distance from the plan (at most 1 each), in
    units of ``tolerance``; nothing without a plan."""
    tolerance: float = 3.0
    """Distance from the plan that counts in full, in standard deviations of the noise."""
    distance: float = 1.0
    """Without a plan: for each key that should be pressed, times how far its finger is away: 0 at
    the key, 0.5 at a distance of ``reach``, nearly 1 far away."""
    reach: float = 0.05
    """Distance of a finger from its key at which half of ``distance`` counts, m."""
    effort: float = 0.01
    """Times the mean square of the change, in standard deviations of the noise."""
    discount: float = 0.9
    """Weight of each control step relative to the one before; above 0, at most 1."""

    def __post_init__(self) -> None:
        for option in dataclasses.fields(self):
            value = getattr(self, option.name)
            _check_number(option.name, value, _real(value) >= 0, "0 or more")
        for name in ("tolerance", "reach", "discount"):
            _check_number(name, getattr(self, name), getattr(self, name) > 0, "above 0")
        _check_number("discount", self.discount, self.discount <= 1, "at most 1")


def check_count(name: str, value: Any, least: int) -> int:
    """Return a whole number, or say what is wrong with it.

    Raises:
        ConfigError: If it is none, or below ``least``.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise ConfigError(f"{name} is {value!r}: expected a whole number from {least} on.")
    return int(value)


def _real(value: Any) -> float:
    """Return a number, or one that no comparison accepts."""
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        return math.nan
    return float(value)


def _check_number(name: str, value: object, valid: bool, expected: str) -> None:
    if not valid:
        raise ConfigError(f"{name} is {value!r}: expected a number, {expected}.")


NOISE_FROM_ZERO = SamplingNoise(knots=3, finger=0.3, wrist=0.15, forearm=0.04, decay=1.0)
"""Noise for sampling without a plan."""

COST_FROM_ZERO = SamplingCost(wrong=1.0)
"""Cost for sampling without a plan, which with dearer wrong keys plays less."""
