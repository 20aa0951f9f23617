"""Predictive sampling: model-predictive control by trying changes in simulation."""

from sb3_piano.planning.sampling.predictive_sampling import NOMINALS, PredictiveSampling
from sb3_piano.planning.sampling.settings import (
    COST_FROM_ZERO,
    NOISE_FROM_ZERO,
    SamplingCost,
    SamplingNoise,
)

__all__ = [
    "COST_FROM_ZERO",
    "NOISE_FROM_ZERO",
    "NOMINALS",
    "PredictiveSampling",
    "SamplingCost",
    "SamplingNoise",
]
