"""Demonstrations: Minari data sets of performances, for replay buffers and cloning."""

from sb3_piano.demonstrations.cloning import Cloning, clone_behaviour, fill_replay_buffer
from sb3_piano.demonstrations.dataset import EXPERT_ACTION, open_dataset, require_minari
from sb3_piano.demonstrations.disturbances import (
    ActuatorNoise,
    CorrelatedNoise,
    NoisyActions,
    PerturbedStart,
)
from sb3_piano.demonstrations.recording import Recorded, record

__all__ = [
    "EXPERT_ACTION",
    "ActuatorNoise",
    "Cloning",
    "CorrelatedNoise",
    "NoisyActions",
    "PerturbedStart",
    "Recorded",
    "clone_behaviour",
    "fill_replay_buffer",
    "open_dataset",
    "record",
    "require_minari",
]
