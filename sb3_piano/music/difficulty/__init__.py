"""Difficulty of a piece: its features, and its rank among others."""

from sb3_piano.music.difficulty.motion import (
    MotionFeatures,
    MotionRecording,
    mean_motion,
    read_motion,
    write_motion,
)
from sb3_piano.music.difficulty.ranking import Difficulty, Features, features, rank

__all__ = [
    "Difficulty",
    "Features",
    "MotionFeatures",
    "MotionRecording",
    "features",
    "mean_motion",
    "rank",
    "read_motion",
    "write_motion",
]
