"""Metrics of performances: pure functions from arrays to numbers."""

from sb3_piano.metrics.episode import DEFINITIONS, EPISODE_METRICS, episode_metrics
from sb3_piano.metrics.frames import frame_f1, frame_scores, noop_scores
from sb3_piano.metrics.losses import Losses, losses_of
from sb3_piano.metrics.onsets import Onsets, match_onsets, onset_f1, onset_scores, onsets_of
from sb3_piano.metrics.presses import Presses, presses_of

__all__ = [
    "DEFINITIONS",
    "EPISODE_METRICS",
    "Losses",
    "Onsets",
    "Presses",
    "episode_metrics",
    "frame_f1",
    "frame_scores",
    "losses_of",
    "match_onsets",
    "noop_scores",
    "onset_f1",
    "onset_scores",
    "onsets_of",
    "presses_of",
]
