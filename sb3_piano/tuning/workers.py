"""What a worker of a study does, in a process of its own: it runs a trial."""

from __future__ import annotations

import gc
import os
import platform
import sys
from dataclasses import dataclass

import optuna

from sb3_piano.interrupts import ended_as_by_ctrl_c
from sb3_piano.links import make_folder
from sb3_piano.tuning.objective import Objective
from sb3_piano.tuning.storage import opened_store
from sb3_piano.tuning.study import Search, StudyConfig, StudyFolder, make_pruner, make_sampler
from sb3_piano.tuning.trials import OWNER


@dataclass(frozen=True, kw_only=True)
class TrialJob:
    """What a worker has to know to run a trial of a study."""

    config: StudyConfig
    folder: StudyFolder
    study_name: str
    storage: str | None
    """URL of the database that the study is in; by default the folder's journal."""
    search: Search

    def __call__(self, owner: list[str]) -> None:
        """Ask for one trial, run it and tell; Optuna does so, and gives heartbeats meanwhile."""
        gc.collect()  # models of the trial before refer to themselves
        self._print_into_log()
        with ended_as_by_ctrl_c(), opened_store(self.storage, self.folder) as store:
            study = optuna.load_study(
                study_name=self.study_name,
                storage=store,
                pruner=make_pruner(self.search, self.config),
            )

            def objective(trial: optuna.Trial) -> float:
                trial.set_user_attr(OWNER, owner)
                study.sampler = make_sampler(self.search, trial.number)
                return Objective(self.config, self.folder)(trial)

            study.optimize(objective, n_trials=1, catch=(Exception,))

    def _print_into_log(self) -> None:
        """Let all that this process prints go to a file of the study."""
        make_folder(self.folder.workers_dir)
        name = f"{platform.node()}-{os.getpid()}.log"
        with (self.folder.workers_dir / name).open("ab") as log:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
                os.dup2(log.fileno(), stream.fileno())
