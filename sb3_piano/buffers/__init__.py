"""Replay buffers for Stable-Baselines3 that exploit the layout of piano observations."""

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
