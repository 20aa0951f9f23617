"""Policies for stock Stable-Baselines3 algorithms."""

from sb3_piano.policies.regularized import (
    RegularizedSACPolicy,
    RegularizedTD3Policy,
    ResidualSACPolicy,
    ResidualTD3Policy,
)

__all__ = [
    "RegularizedSACPolicy",
    "RegularizedTD3Policy",
    "ResidualSACPolicy",
    "ResidualTD3Policy",
]
