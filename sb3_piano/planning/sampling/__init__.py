"""Predictive sampling: model-predictive control by trying changes in simulation."""

from sb3_piano.planning.sampling.cost import COST_FROM_ZERO, SamplingCost
from sb3_piano.planning.sampling.noise import NOISE_FROM_ZERO, SamplingNoise
from sb3_piano.planning.sampling.predictive_sampling import PredictiveSampling

__all__ = [
    "COST_FROM_ZERO",
    "NOISE_FROM_ZERO",
    "PredictiveSampling",
    "SamplingCost",
    "SamplingNoise",
]
