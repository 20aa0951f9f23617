"""Training runs: YAML to environments, model and files; resuming and evaluating them."""

from sb3_piano.training.algorithms import ALGORITHMS, PLANNERS
from sb3_piano.training.cloning import CloneResult, clone
from sb3_piano.training.compare import MAIN_METRICS, Comparison, compare
from sb3_piano.training.config import RunConfig
from sb3_piano.training.evaluate import Evaluation, evaluate
from sb3_piano.training.evaluations import Evaluations, evaluate_runs
from sb3_piano.training.play import play_run, play_score
from sb3_piano.training.playing import SavedPlayer
from sb3_piano.training.plugins import Plugin
from sb3_piano.training.report import training_curves, write_report
from sb3_piano.training.run_folder import RunFolder
from sb3_piano.training.session import TrainResult
from sb3_piano.training.share import share
from sb3_piano.training.train import resume, train
from sb3_piano.training.yaml_config import entry_config, load_config, load_entry
from sb3_piano.viewing import Picture, Played

__all__ = [
    "ALGORITHMS",
    "MAIN_METRICS",
    "PLANNERS",
    "CloneResult",
    "Comparison",
    "Evaluation",
    "Evaluations",
    "Picture",
    "Played",
    "Plugin",
    "RunConfig",
    "RunFolder",
    "SavedPlayer",
    "TrainResult",
    "clone",
    "compare",
    "entry_config",
    "evaluate",
    "evaluate_runs",
    "load_config",
    "load_entry",
    "play_run",
    "play_score",
    "resume",
    "share",
    "train",
    "training_curves",
    "write_report",
]
