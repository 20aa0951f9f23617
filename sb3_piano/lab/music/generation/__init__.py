"""Generated music: pieces for two hands made by rules, for policies that learn to read."""

from sb3_piano.lab.music.generation.making import generate_score
from sb3_piano.lab.music.generation.styles import STYLES

__all__ = ["STYLES", "generate_score"]
