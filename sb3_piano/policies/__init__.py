"""Policies for stock Stable-Baselines3 algorithms."""

from sb3_piano.policies.hand_network import (
    hand_weights,
    load_hand_weights,
    set_standardization,
)
from sb3_piano.policies.hands import HandsActorCriticPolicy, HandsSACPolicy, HandsTD3Policy
from sb3_piano.policies.regularized import (
    RegularizedSACPolicy,
    RegularizedTD3Policy,
    ResidualSACPolicy,
    ResidualTD3Policy,
)

__all__ = [
    "HandsActorCriticPolicy",
    "HandsSACPolicy",
    "HandsTD3Policy",
    "RegularizedSACPolicy",
    "RegularizedTD3Policy",
    "ResidualSACPolicy",
    "ResidualTD3Policy",
    "hand_weights",
    "load_hand_weights",
    "set_standardization",
]
