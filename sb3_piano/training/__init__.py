"""Training runs: YAML to environments, model and files; resuming and evaluating them."""

from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.env_spec import EnvSpec
from sb3_piano.training.configuration.names import ALGORITHMS, KNOWN_PACKAGES
from sb3_piano.training.configuration.plugins import Plugin
from sb3_piano.training.configuration.yaml_files import (
    entry_config,
    load_config,
    load_entry,
)
from sb3_piano.training.evaluation.comparison import MAIN_METRICS, Comparison, compare
from sb3_piano.training.evaluation.evaluate import evaluate, evaluate_runs
from sb3_piano.training.evaluation.evaluations import Evaluation, Evaluations
from sb3_piano.training.evaluation.report import (
    training_curves,
    write_piece_report,
    write_report,
)
from sb3_piano.training.playing.player import OpenPlayer, SavedPlayer
from sb3_piano.training.playing.residual import RunResidual
from sb3_piano.training.playing.takes import play_run, play_score
from sb3_piano.training.runs.clone import CloneResult, clone
from sb3_piano.training.runs.fine_tuning import load_fine_tuning
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.start import StartFromRun, load_start
from sb3_piano.training.runs.train import TrainResult, resume, train
from sb3_piano.training.sharing.export import ExportedFolder, export_run
from sb3_piano.training.sharing.hub import load_player
from sb3_piano.viewing import Picture, Played

__all__ = [
    "ALGORITHMS",
    "KNOWN_PACKAGES",
    "MAIN_METRICS",
    "CloneResult",
    "Comparison",
    "EnvSpec",
    "Evaluation",
    "Evaluations",
    "ExportedFolder",
    "OpenPlayer",
    "Picture",
    "Played",
    "Plugin",
    "RunConfig",
    "RunFolder",
    "RunResidual",
    "SavedPlayer",
    "StartFromRun",
    "TrainResult",
    "clone",
    "compare",
    "entry_config",
    "evaluate",
    "evaluate_runs",
    "export_run",
    "load_config",
    "load_entry",
    "load_fine_tuning",
    "load_player",
    "load_start",
    "play_run",
    "play_score",
    "resume",
    "train",
    "training_curves",
    "write_piece_report",
    "write_report",
]
