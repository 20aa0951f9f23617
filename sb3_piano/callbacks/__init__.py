"""Stable-Baselines3 callbacks: music metrics, progress and checkpoints that can be resumed."""

from sb3_piano.callbacks.checkpoint import Checkpoint, ResumableCheckpoint
from sb3_piano.callbacks.episode_metrics import EpisodeMetricsCallback
from sb3_piano.callbacks.progress import PianoProgressBar
from sb3_piano.callbacks.replay_segments import restore_replay_buffer

__all__ = [
    "Checkpoint",
    "EpisodeMetricsCallback",
    "PianoProgressBar",
    "ResumableCheckpoint",
    "restore_replay_buffer",
]
