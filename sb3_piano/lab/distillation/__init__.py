"""Distillation: one network that learns from a teacher to play any piece, in rounds."""

from sb3_piano.lab.distillation.config import (
    DEFAULT_FILE,
    DistillConfig,
    EvaluationSettings,
    Improvement,
    NetworkSettings,
    PlayingSettings,
    Round,
    TeacherSettings,
)
from sb3_piano.lab.distillation.distill import DistillResult, distill
from sb3_piano.lab.distillation.rounds import RoundResult

__all__ = [
    "DEFAULT_FILE",
    "DistillConfig",
    "DistillResult",
    "EvaluationSettings",
    "Improvement",
    "NetworkSettings",
    "PlayingSettings",
    "Round",
    "RoundResult",
    "TeacherSettings",
    "distill",
]
