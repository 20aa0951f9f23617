"""Searching hyperparameters with Optuna."""

from sb3_piano.tuning.objective import Objective
from sb3_piano.tuning.parameters import Parameter
from sb3_piano.tuning.space import SPACES, Space, load_space
from sb3_piano.tuning.study import (
    METRICS,
    OBJECTIVES,
    PRUNERS,
    SAMPLERS,
    Search,
    StudyConfig,
    StudyFolder,
)
from sb3_piano.tuning.tune import TuneResult, tune

__all__ = [
    "METRICS",
    "OBJECTIVES",
    "PRUNERS",
    "SAMPLERS",
    "SPACES",
    "Objective",
    "Parameter",
    "Search",
    "Space",
    "StudyConfig",
    "StudyFolder",
    "TuneResult",
    "load_space",
    "tune",
]
