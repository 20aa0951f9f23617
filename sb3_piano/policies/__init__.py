"""Policies for stock Stable-Baselines3 algorithms."""

from sb3_piano.policies.regularized import RegularizedSACPolicy, RegularizedTD3Policy
from sb3_piano.policies.residual import ResidualSACPolicy, ResidualTD3Policy

__all__ = [
    "RegularizedSACPolicy",
    "RegularizedTD3Policy",
    "ResidualSACPolicy",
    "ResidualTD3Policy",
]
