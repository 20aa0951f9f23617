"""Assign hands and fingers to scores, and measure the agreement of two fingerings."""

from sb3_piano.music.fingering.agreement import Agreement, agreement
from sb3_piano.music.fingering.apply import apply_fingering, finger_score, without_fingers

__all__ = ["Agreement", "agreement", "apply_fingering", "finger_score", "without_fingers"]
