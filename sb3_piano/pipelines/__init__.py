"""Pipelines: curricula, sweeps and corpora, each a list of jobs in a folder."""

from sb3_piano.pipelines.corpus import CorpusConfig, record_corpus
from sb3_piano.pipelines.curriculum import run_curriculum
from sb3_piano.pipelines.stages import Curriculum, Stage, load_curriculum
from sb3_piano.pipelines.sweep import SweepConfig, load_sweep, sweep
from sb3_piano.pipelines.training import TrainingJob

__all__ = [
    "CorpusConfig",
    "Curriculum",
    "Stage",
    "SweepConfig",
    "TrainingJob",
    "load_curriculum",
    "load_sweep",
    "record_corpus",
    "run_curriculum",
    "sweep",
]
