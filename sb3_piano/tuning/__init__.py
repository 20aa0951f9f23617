"""Searching hyperparameters with Optuna."""

from sb3_piano.tuning.objective import Objective
from sb3_piano.tuning.samplers import PRUNERS, SAMPLERS, Search
from sb3_piano.tuning.search_space.built_in import SPACES
from sb3_piano.tuning.search_space.parsing import Choice, Discount, Float, Int, Parameter
from sb3_piano.tuning.search_space.space import Space, load_space
from sb3_piano.tuning.study_config import METRICS, OBJECTIVES, StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder
from sb3_piano.tuning.tune import TuneResult, tune

__all__ = [
    "METRICS",
    "OBJECTIVES",
    "PRUNERS",
    "SAMPLERS",
    "SPACES",
    "Choice",
    "Discount",
    "Float",
    "Int",
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
