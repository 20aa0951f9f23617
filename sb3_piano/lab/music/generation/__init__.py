"""Generate rule-based pieces for two hands, for training sight-reading policies."""

from sb3_piano.lab.music.generation.making import generate_score
from sb3_piano.lab.music.generation.styles import STYLES

__all__ = ["STYLES", "generate_score"]
