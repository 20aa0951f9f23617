"""Policies for stock Stable-Baselines3 algorithms."""

from sb3_piano.policies.encoders import EncoderSACPolicy, EncoderTD3Policy, EncoderTQCPolicy
from sb3_piano.policies.hand_network import (
    hand_weights,
    load_hand_weights,
    set_standardization,
)
from sb3_piano.policies.hands import HandsActorCriticPolicy, HandsSACPolicy, HandsTD3Policy
from sb3_piano.policies.regularized import (
    RegularizedSACPolicy,
    RegularizedTD3Policy,
    RegularizedTQCPolicy,
)
from sb3_piano.policies.simba import RSNorm, SimbaSACPolicy, SimbaTD3Policy, SimbaTQCPolicy
from sb3_piano.policies.sparing import sparing_updates

__all__ = [
    "EncoderSACPolicy",
    "EncoderTD3Policy",
    "EncoderTQCPolicy",
    "HandsActorCriticPolicy",
    "HandsSACPolicy",
    "HandsTD3Policy",
    "RSNorm",
    "RegularizedSACPolicy",
    "RegularizedTD3Policy",
    "RegularizedTQCPolicy",
    "SimbaSACPolicy",
    "SimbaTD3Policy",
    "SimbaTQCPolicy",
    "hand_weights",
    "load_hand_weights",
    "set_standardization",
    "sparing_updates",
]
