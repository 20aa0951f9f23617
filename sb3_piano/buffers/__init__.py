"""Replay buffers for Stable-Baselines3 that know what a piano observation is made of."""

from sb3_piano.buffers.compact import (
    CompactDictReplayBuffer,
    CompactNStepReplayBuffer,
    CompactReplayBuffer,
)
from sb3_piano.buffers.cycling import CyclingReplayBuffer

__all__ = [
    "CompactDictReplayBuffer",
    "CompactNStepReplayBuffer",
    "CompactReplayBuffer",
    "CyclingReplayBuffer",
]
