"""Demonstrations: performances as Minari data sets, for replay buffers and for cloning."""

from sb3_piano.demonstrations.cloning import Cloning, clone_behaviour
from sb3_piano.demonstrations.dataset import EXPERT_ACTION, open_dataset
from sb3_piano.demonstrations.disturbances import ActuatorNoise, PerturbedStart
from sb3_piano.demonstrations.recording import Recorded, record
from sb3_piano.demonstrations.replay import fill_replay_buffer

__all__ = [
    "EXPERT_ACTION",
    "ActuatorNoise",
    "Cloning",
    "PerturbedStart",
    "Recorded",
    "clone_behaviour",
    "fill_replay_buffer",
    "open_dataset",
    "record",
]
