"""Distillation (DAgger): train one network for any piece from a teacher, in rounds."""

from sb3_piano.lab.distillation.config import DEFAULT_FILE, DistillConfig
from sb3_piano.lab.distillation.distill import DistillResult, distill

__all__ = ["DEFAULT_FILE", "DistillConfig", "DistillResult", "distill"]
