"""Predictive sampling: model-predictive control by random search in simulation."""

from sb3_piano.planning.sampling.cost import COST_FROM_ZERO, SamplingCost
from sb3_piano.planning.sampling.noise import NOISE_FROM_ZERO, SamplingNoise

__all__ = [
    "COST_FROM_ZERO",
    "NOISE_FROM_ZERO",
    "SamplingCost",
    "SamplingNoise",
]
