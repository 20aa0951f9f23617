"""Policies for stock Stable-Baselines3 algorithms."""

from sb3_piano.policies.encoders import EncoderSACPolicy
from sb3_piano.policies.encoders import EncoderTD3Policy as EncoderTD3Policy
from sb3_piano.policies.encoders import EncoderTQCPolicy as EncoderTQCPolicy
from sb3_piano.policies.hand_network import hand_weights as hand_weights
from sb3_piano.policies.hand_network import load_hand_weights as load_hand_weights
from sb3_piano.policies.hand_network import set_standardization as set_standardization
from sb3_piano.policies.hands import HandsActorCriticPolicy, HandsSACPolicy, HandsTD3Policy
from sb3_piano.policies.hands import HandsTQCPolicy as HandsTQCPolicy
from sb3_piano.policies.regularized import RegularizedSACPolicy, RegularizedTD3Policy
from sb3_piano.policies.regularized import RegularizedTQCPolicy as RegularizedTQCPolicy
from sb3_piano.policies.simba import RSNorm as RSNorm
from sb3_piano.policies.simba import SimbaSACPolicy
from sb3_piano.policies.simba import SimbaTD3Policy as SimbaTD3Policy
from sb3_piano.policies.simba import SimbaTQCPolicy as SimbaTQCPolicy
from sb3_piano.policies.sparing import fast_updates
from sb3_piano.policies.sparing import sparing_updates as sparing_updates

__all__ = [
    "EncoderSACPolicy",
    "HandsActorCriticPolicy",
    "HandsSACPolicy",
    "HandsTD3Policy",
    "RegularizedSACPolicy",
    "RegularizedTD3Policy",
    "SimbaSACPolicy",
    "fast_updates",
]
