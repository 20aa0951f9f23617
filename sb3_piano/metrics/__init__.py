"""Metrics of performances: pure functions from arrays to numbers."""

from sb3_piano.metrics.episode import (
    DEFINITIONS,
    EPISODE_METRICS,
    FINGER_SHARES,
    Definition,
    episode_metrics,
    has_value,
    normalized_return,
)
from sb3_piano.metrics.fingers import (
    KeyBoxes,
    effective_fingers,
    finger_shares,
    fingering_agreement,
    nearest_fingers,
)
from sb3_piano.metrics.frames import (
    FrameScores,
    frame_f1,
    frame_scores,
    non_silent_f1,
    noop_scores,
)
from sb3_piano.metrics.losses import DUE_KINDS, WRONG_KINDS, Losses, losses_of, shares_of
from sb3_piano.metrics.onsets import (
    ONSET_TOLERANCE,
    Onsets,
    OnsetScores,
    TimingError,
    match_onsets,
    onset_f1,
    onset_scores,
    onsets_of,
    timing_error,
)
from sb3_piano.metrics.presses import Presses, presses_of, wrong_presses, wrong_presses_per_second

__all__ = [
    "DEFINITIONS",
    "DUE_KINDS",
    "EPISODE_METRICS",
    "FINGER_SHARES",
    "ONSET_TOLERANCE",
    "WRONG_KINDS",
    "Definition",
    "FrameScores",
    "KeyBoxes",
    "Losses",
    "OnsetScores",
    "Onsets",
    "Presses",
    "TimingError",
    "effective_fingers",
    "episode_metrics",
    "finger_shares",
    "fingering_agreement",
    "frame_f1",
    "frame_scores",
    "has_value",
    "losses_of",
    "match_onsets",
    "nearest_fingers",
    "non_silent_f1",
    "noop_scores",
    "normalized_return",
    "onset_f1",
    "onset_scores",
    "onsets_of",
    "presses_of",
    "shares_of",
    "timing_error",
    "wrong_presses",
    "wrong_presses_per_second",
]
