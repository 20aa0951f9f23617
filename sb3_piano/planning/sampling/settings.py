"""Settings of predictive sampling."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Gt, Le

from sb3_piano.settings import Count, Number, Positive, Share, settings

_NotNegative = Annotated[Number, Ge(0)]
_SomeShare = Annotated[Number, Gt(0), Le(1)]


@settings
class SamplingNoise:
    """Random differences of candidates from the best of the last control step.

    The defaults are for sampling around a plan.

    Raises:
        ConfigError: If a value is out of range.
    """

    share: _SomeShare = 0.4
    """Of the actuators, which a candidate changes; above 0, at most 1."""
    knots: Count = 2
    """Points of the horizon at which noise is drawn, the first and the last step included; it is
    linear between them. 1 (constant noise) or more."""
    finger: _NotNegative = 0.12
    """Standard deviation at a knot, rad, of the fingers' actuators."""
    wrist: _NotNegative = 0.04
    """That of the wrists' actuators, rad."""
    forearm: _NotNegative = 0.008
    """That of the sliders on which the forearms stand, m."""
    decay: Share = 0.9
    """Share of the last control step's best change that is kept for the next one, in [0, 1]."""


@settings
class SamplingCost:
    """Weights of a candidate's cost in each control step; less is better.

    Raises:
        ConfigError: If a value is out of range.
    """

    missed: _NotNegative = 1.0
    """For each key that should sound and does not."""
    wrong: _NotNegative = 1.5
    """For each key that sounds and should not."""
    reluctant: _NotNegative = 0.5
    """For each key that should sound, times the share of the way to sounding that is missing."""
    brushed: _NotNegative = 0.1
    """For each key that should not sound, times the square of the share of the way that it is down
    (at most 1)."""
    astray: _NotNegative = 0.5
    """Times the mean over the actuators of the squared distance from the plan (at most 1 each), in
    units of ``tolerance``; nothing without a plan."""
    tolerance: Positive = 3.0
    """Distance from the plan that counts in full, in standard deviations of the noise."""
    distance: _NotNegative = 1.0
    """Without a plan: for each key that should be pressed, times how far its finger is away: 0 at
    the key, 0.5 at a distance of ``reach``, nearly 1 far away."""
    reach: Positive = 0.05
    """Distance of a finger from its key at which half of ``distance`` counts, m."""
    effort: _NotNegative = 0.01
    """Times the mean square of the change, in standard deviations of the noise."""
    discount: _SomeShare = 0.9
    """Weight of each control step relative to the one before; above 0, at most 1."""


NOISE_FROM_ZERO = SamplingNoise(knots=3, finger=0.3, wrist=0.15, forearm=0.04, decay=1.0)
"""Noise for sampling without a plan."""

COST_FROM_ZERO = SamplingCost(wrong=1.0)
"""Cost for sampling without a plan, which with dearer wrong keys plays less."""
