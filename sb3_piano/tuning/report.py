"""Reports of a study: a page with Optuna's figures that needs no network, and a CSV table."""

from __future__ import annotations

import shlex
from collections import Counter
from pathlib import Path
from typing import Any

import gymnasium as gym
import optuna
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.files import write_csv, write_text
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.training.configuration.names import registered_id
from sb3_piano.tuning import trials
from sb3_piano.tuning.best import (
    CAVEAT,
    best_entry,
    objective_in_words,
    train_commands,
    training_in_words,
)
from sb3_piano.tuning.entries import MISSING, setting_at, with_defaults
from sb3_piano.tuning.figures import STATES, study_figures
from sb3_piano.tuning.objective import RESULTS
from sb3_piano.tuning.study import StudyConfig, StudyFolder
from sb3_piano.viewing.report.page import render

MOST_TRIALS = 10
"""Trials in the table of the best ones."""
REPEATED = "repeated"
"""The state of a trial that does not count, as another one has its settings."""

_NOTHING = "\N{EN DASH}"
_NOTED = (*RESULTS, trials.STEPS, trials.SECONDS, trials.ORIGIN, trials.HOST, trials.FOLDER)


def write_table(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> Path:
    """Write a row for each trial into the study's folder.

    ``value`` is, of a pruned trial, the last one that it reported. Settings stand as the training
    got them. What a trial does not have is left empty.

    Returns:
        The file.
    """
    found = study.get_trials(deepcopy=False)
    again = trials.repeated(found)
    before, after = _NOTED[:-2], (trials.FAILURE, *_NOTED[-2:])
    rows = (
        {
            **{name: trial.user_attrs.get(name) for name in _NOTED},
            **config.space.settings(trial.params),
            "number": trial.number,
            "state": REPEATED if trial.number in again else STATES[trial.state],
            "value": trial.value,
            trials.FAILURE: trials.failure_of(trial),
        }
        for trial in found
    )
    columns = ("number", "state", "value", *before, *config.space, *after)
    write_csv(folder.table_file, columns, rows)
    return folder.table_file


def write_report(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> Path:
    """Write the report into the study's folder.

    Returns:
        The file.
    """
    write_text(folder.report_file, report_html(study, config, folder))
    return folder.report_file


def report_html(study: optuna.Study, config: StudyConfig, folder: StudyFolder | None = None) -> str:
    """Return the page.

    Args:
        study: The study, whatever it holds so far.
        config: What it searches.
        folder: Where it is, for the commands; by default the present folder.
    """
    label = f"{config.objective} {DEFINITIONS[config.metric].label}"
    count, best = trials.counting(study), trials.best_trial(study)
    counts = Counter(trial.state for trial in count)
    failures = [(trial.number, trials.failure_of(trial)) for trial in count]
    return render(
        "study.html",
        title=study.study_name,
        subject=_subject(config),
        caveat=CAVEAT,
        trials=len(count),
        states=[f"{counts[state]} {name}" for state, name in STATES.items() if counts[state]],
        complete=counts[TrialState.COMPLETE],
        repeated=len(trials.repeated(study.get_trials(deepcopy=False))),
        best=best,
        preset=trials.preset_trial(study),
        settings=[] if best is None else _settings(best, config),
        results=RESULTS,
        searched=list(config.space),
        best_trials=[_row(trial, config) for trial in trials.best_first(study)[:MOST_TRIALS]],
        failures=[(number, reason) for number, reason in failures if reason is not None],
        **study_figures(study, label),
        facts=[("Value", objective_in_words(config)), ("Training", training_in_words(config))],
        commands=_commands(study, config, StudyFolder(Path()) if folder is None else folder),
    )


def _subject(config: StudyConfig) -> str:
    env_id = registered_id(config.env_id)[1]
    score = {**gym.spec(env_id).kwargs, **config.config.env_kwargs}.get("score")
    piece = f" · {Path(score).stem}" if isinstance(score, str) else ""
    return f"Study of {config.algo.upper()} · {env_id}{piece}"


def _settings(best: FrozenTrial, config: StudyConfig) -> list[tuple[str, str, str]]:
    """Return name, best and preset's value of each setting that is searched."""
    found = config.space.settings(best.params)
    preset = with_defaults(config.algo, config.env_id, config.entry)
    return [
        (name, shown(found.get(name, MISSING)), shown(setting_at(preset, name)))
        for name in config.space
    ]


def _row(trial: FrozenTrial, config: StudyConfig) -> list[Any]:
    settings = config.space.settings(trial.params)
    values = (trial.value, *map(trial.user_attrs.get, RESULTS))
    return [
        trial.number,
        *(_NOTHING if value is None else f"{value:.3f}" for value in values),
        *(shown(settings.get(name, MISSING)) for name in config.space),
        trial.user_attrs.get(trials.ORIGIN, ""),
    ]


def shown(value: Any) -> str:
    """Return a setting as it is written in a table.

    >>> shown(0.00123456)
    '0.001235'
    """
    if value is MISSING:
        return _NOTHING
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _commands(
    study: optuna.Study, config: StudyConfig, folder: StudyFolder
) -> list[tuple[str, str]]:
    entry = best_entry(study, config)
    commands = {} if entry is None else train_commands(config, folder.best_file, entry)
    journal = folder.journal_file
    store = shlex.quote(str(journal)) if folder.path == Path() or journal.exists() else "URL"
    return [*commands.items(), ("Look closer", f"optuna-dashboard {store}")]
