"""The folder of a study: where everything stands that tuning makes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class StudyFolder:
    """A study's folder.

    =================== ==========================================================================
    ``journal.log``     Optuna's journal, the store of the study unless it is in a database
    ``best.yml``        the best settings, for ``sb3-piano train --config`` and for RL Zoo
    ``report.html``     history, importance and more in one page that needs no network
    ``trials.csv``      a row for each trial
    ``trials/<n>/``     the runs of trial n, one for each seed: ``seed_<seed>``
    ``workers/``        a ``<name>.log`` with what each worker printed; a ``<name>.lock`` that is
                        locked for as long as the worker lives
    =================== ==========================================================================
    """

    path: Path

    @property
    def journal_file(self) -> Path:
        """The store of the study, unless it is in a database."""
        return self.path / "journal.log"

    @property
    def best_file(self) -> Path:
        """The best settings."""
        return self.path / "best.yml"

    @property
    def report_file(self) -> Path:
        """The report."""
        return self.path / "report.html"

    @property
    def table_file(self) -> Path:
        """A row for each trial."""
        return self.path / "trials.csv"

    @property
    def workers_dir(self) -> Path:
        """Locks and logs of the workers."""
        return self.path / "workers"

    def trial_dir(self, number: int) -> Path:
        """Return where the runs of a trial are."""
        return self.path / "trials" / str(number)
