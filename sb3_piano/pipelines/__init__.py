"""Pipelines: curricula, sweeps and corpora, each a list of jobs in a folder."""

from sb3_piano.callbacks import Condition
from sb3_piano.demonstrations.corpus import RecordedCorpus
from sb3_piano.pipelines.corpus import PlayedSo, corpus_status, record_corpus, summary
from sb3_piano.pipelines.corpus_settings import DEFAULT_NOISE, CorpusConfig
from sb3_piano.pipelines.curriculum import (
    CurriculumResult,
    StageProgress,
    curriculum_status,
    run_curriculum,
)
from sb3_piano.pipelines.grid import SweepConfig, load_sweep
from sb3_piano.pipelines.stages import Curriculum, Stage, load_curriculum
from sb3_piano.pipelines.sweep import SweepResult, sweep, sweep_status
from sb3_piano.pipelines.training import TrainingJob, training
from sb3_piano.pipelines.watch import StageEvaluation

__all__ = [
    "DEFAULT_NOISE",
    "Condition",
    "CorpusConfig",
    "Curriculum",
    "CurriculumResult",
    "PlayedSo",
    "RecordedCorpus",
    "Stage",
    "StageEvaluation",
    "StageProgress",
    "SweepConfig",
    "SweepResult",
    "TrainingJob",
    "corpus_status",
    "curriculum_status",
    "load_curriculum",
    "load_sweep",
    "record_corpus",
    "run_curriculum",
    "summary",
    "sweep",
    "sweep_status",
    "training",
]
