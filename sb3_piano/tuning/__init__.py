"""Search hyperparameters with Optuna."""

from sb3_piano.tuning.objective import Objective
from sb3_piano.tuning.space import Space, load_space
from sb3_piano.tuning.study import Search, StudyConfig, StudyFolder
from sb3_piano.tuning.tune import TuneResult, tune

__all__ = [
    "Objective",
    "Search",
    "Space",
    "StudyConfig",
    "StudyFolder",
    "TuneResult",
    "load_space",
    "tune",
]
