"""Fingering: hands and fingers for scores that have none, and how far two fingerings agree."""

from sb3_piano.music.fingering.agreement import (
    Agreement,
    MatchRates,
    agreement,
    judge,
    judge_annotated,
    match_rates,
    pig_files,
)
from sb3_piano.music.fingering.apply import (
    FINGERINGS,
    apply_fingering,
    finger_score,
    without_fingers,
)
from sb3_piano.music.fingering.labels import read_labels
from sb3_piano.music.fingering.split import assign_hands

__all__ = [
    "FINGERINGS",
    "Agreement",
    "MatchRates",
    "agreement",
    "apply_fingering",
    "assign_hands",
    "finger_score",
    "judge",
    "judge_annotated",
    "match_rates",
    "pig_files",
    "read_labels",
    "without_fingers",
]
