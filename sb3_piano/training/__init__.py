"""Train, resume, evaluate and play runs configured in YAML.

Names are imported on first use, so that players need no torch.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sb3_piano.training.configuration.config import RunConfig
    from sb3_piano.training.configuration.env_spec import EnvSpec
    from sb3_piano.training.configuration.plugins import Plugin
    from sb3_piano.training.configuration.yaml_files import load_config, load_entry
    from sb3_piano.training.evaluation.comparison import compare
    from sb3_piano.training.evaluation.evaluate import evaluate
    from sb3_piano.training.evaluation.report import write_report
    from sb3_piano.training.playing.player import OpenPlayer
    from sb3_piano.training.playing.residual import RunResidual
    from sb3_piano.training.playing.takes import play_run
    from sb3_piano.training.runs.clone import clone
    from sb3_piano.training.runs.fine_tuning import load_fine_tuning
    from sb3_piano.training.runs.folder import RunFolder
    from sb3_piano.training.runs.start import StartFromRun, load_start
    from sb3_piano.training.runs.train import resume, train
    from sb3_piano.training.sharing.export import export_run
    from sb3_piano.training.sharing.hub import load_player

__all__ = [
    "EnvSpec",
    "OpenPlayer",
    "Plugin",
    "RunConfig",
    "RunFolder",
    "RunResidual",
    "StartFromRun",
    "clone",
    "compare",
    "evaluate",
    "export_run",
    "load_config",
    "load_entry",
    "load_fine_tuning",
    "load_player",
    "load_start",
    "play_run",
    "resume",
    "train",
    "write_report",
]

_MODULES = {
    "EnvSpec": "configuration.env_spec",
    "OpenPlayer": "playing.player",
    "Plugin": "configuration.plugins",
    "RunConfig": "configuration.config",
    "RunFolder": "runs.folder",
    "RunResidual": "playing.residual",
    "SavedPlayer": "playing.player",
    "StartFromRun": "runs.start",
    "clone": "runs.clone",
    "compare": "evaluation.comparison",
    "evaluate": "evaluation.evaluate",
    "export_run": "sharing.export",
    "load_config": "configuration.yaml_files",
    "load_entry": "configuration.yaml_files",
    "load_fine_tuning": "runs.fine_tuning",
    "load_player": "sharing.hub",
    "load_start": "runs.start",
    "play_run": "playing.takes",
    "resume": "runs.train",
    "train": "runs.train",
    "write_report": "evaluation.report",
}
"""Module of each name; ``SavedPlayer`` is the deprecated name of ``OpenPlayer``."""


def __getattr__(name: str) -> Any:
    """Import a name on first use."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
