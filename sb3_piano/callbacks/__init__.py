"""Stable-Baselines3 callbacks: music in log and evaluation, progress, checkpoints, videos."""

from sb3_piano.callbacks.action_search import ActionSearchCallback
from sb3_piano.callbacks.averaged_weights import AveragedWeightsCallback
from sb3_piano.callbacks.beginning import (
    DemonstrationsCallback,
    HandWeightsCallback,
    SightReaderStandardization,
)
from sb3_piano.callbacks.checkpoint import Checkpoint as Checkpoint
from sb3_piano.callbacks.checkpoint import KeepsState as KeepsState
from sb3_piano.callbacks.checkpoint import ResumableCheckpoint as ResumableCheckpoint
from sb3_piano.callbacks.condition import Condition as Condition
from sb3_piano.callbacks.difficulty_curriculum import DifficultyCallback
from sb3_piano.callbacks.episode_metrics import EpisodeMetricsCallback, RewardTermsCallback
from sb3_piano.callbacks.hindsight import HindsightCallback
from sb3_piano.callbacks.level_replay import LevelReplayCallback
from sb3_piano.callbacks.metric_eval import F1Callback, MetricEvalCallback, OnsetF1Callback
from sb3_piano.callbacks.performance_video import PerformanceVideoCallback
from sb3_piano.callbacks.progress import PianoProgressBar as PianoProgressBar
from sb3_piano.callbacks.q_value import QValueCallback
from sb3_piano.callbacks.replay_segments import restore_replay_buffer as restore_replay_buffer

__all__ = [
    "ActionSearchCallback",
    "AveragedWeightsCallback",
    "DemonstrationsCallback",
    "DifficultyCallback",
    "EpisodeMetricsCallback",
    "F1Callback",
    "HandWeightsCallback",
    "HindsightCallback",
    "LevelReplayCallback",
    "MetricEvalCallback",
    "OnsetF1Callback",
    "PerformanceVideoCallback",
    "QValueCallback",
    "RewardTermsCallback",
    "SightReaderStandardization",
]
