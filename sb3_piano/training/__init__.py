"""Training runs: YAML to environments, model and files; resuming and evaluating them."""

from sb3_piano.training.algorithms import ALGORITHMS
from sb3_piano.training.config import RunConfig
from sb3_piano.training.evaluate import Evaluation, evaluate
from sb3_piano.training.plugins import Plugin
from sb3_piano.training.run_folder import RunFolder
from sb3_piano.training.session import TrainResult
from sb3_piano.training.train import resume, train
from sb3_piano.training.yaml_config import load_config

__all__ = [
    "ALGORITHMS",
    "Evaluation",
    "Plugin",
    "RunConfig",
    "RunFolder",
    "TrainResult",
    "evaluate",
    "load_config",
    "resume",
    "train",
]
