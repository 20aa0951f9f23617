"""All trials of a study in one CSV file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import optuna
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.files import write_csv
from sb3_piano.tuning.attributes import (
    FAILURE,
    FOLDER,
    HOST,
    ORIGIN,
    SECONDS,
    STEPS,
    repeated,
    result_name,
)
from sb3_piano.tuning.study_config import METRICS, OBJECTIVES, StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder

RESULTS = tuple(result_name(objective, metric) for objective in OBJECTIVES for metric in METRICS)
"""Names of all results of a trial."""

STATES = {
    TrialState.COMPLETE: "complete",
    TrialState.PRUNED: "pruned",
    TrialState.FAIL: "failed",
    TrialState.RUNNING: "running",
    TrialState.WAITING: "waiting",
}
"""What states are called where users read them."""

REPEATED = "repeated"
"""The state of a trial that does not count, as another one has its settings."""

_BEFORE = (*RESULTS, STEPS, SECONDS, ORIGIN)
_AFTER = (FAILURE, HOST, FOLDER)


def write_table(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> Path:
    """Write a row for each trial into the study's folder.

    ``value`` is, of a pruned trial, the last one that it reported. Settings stand as the training
    got them. What a trial does not have is left empty.

    Returns:
        The file.
    """
    trials = study.get_trials(deepcopy=False)
    again = repeated(trials)
    columns = ("number", "state", "value", *_BEFORE, *config.space, *_AFTER)
    rows = (_row(trial, config, trial.number in again) for trial in trials)
    write_csv(folder.table_file, columns, rows)
    return folder.table_file


def _row(trial: FrozenTrial, config: StudyConfig, again: bool) -> dict[str, Any]:
    noted = {name: trial.user_attrs.get(name) for name in (*_BEFORE, *_AFTER)}
    return {
        "number": trial.number,
        "state": REPEATED if again else STATES[trial.state],
        "value": trial.value,
        **config.space.settings(trial.params),
        **noted,
    }
