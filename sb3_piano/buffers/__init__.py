"""Replay buffers for Stable-Baselines3 that know what a piano observation is made of."""

from sb3_piano.buffers.compact import CompactNStepReplayBuffer, CompactReplayBuffer

__all__ = ["CompactNStepReplayBuffer", "CompactReplayBuffer"]
