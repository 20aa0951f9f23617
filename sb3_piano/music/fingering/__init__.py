"""Fingering: hands and fingers for scores that have none, and how far two fingerings agree."""

from sb3_piano.music.fingering.agreement import Agreement, agreement
from sb3_piano.music.fingering.apply import apply_fingering, finger_score, without_fingers

__all__ = ["Agreement", "agreement", "apply_fingering", "finger_score", "without_fingers"]
