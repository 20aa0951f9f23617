"""How hard a piece is: its features, and its rank among others."""

from sb3_piano.music.difficulty.features import Features, features
from sb3_piano.music.difficulty.motion import MotionFeatures, mean_motion, motion_features
from sb3_piano.music.difficulty.ranking import Difficulty, rank
from sb3_piano.music.difficulty.recording import MotionRecording, read_motion, write_motion

__all__ = [
    "Difficulty",
    "Features",
    "MotionFeatures",
    "MotionRecording",
    "features",
    "mean_motion",
    "motion_features",
    "rank",
    "read_motion",
    "write_motion",
]
