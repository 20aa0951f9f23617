"""The report of a study: one HTML page with Optuna's figures that needs no network."""

from __future__ import annotations

import shlex
from collections import Counter
from pathlib import Path
from typing import Any

import gymnasium as gym
import optuna
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.files import write_text
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.training.configuration.names import registered_id
from sb3_piano.tuning.attributes import FAILURE, ORIGIN, counting, repeated
from sb3_piano.tuning.outcome.best import (
    CAVEAT,
    best_entry,
    best_trial,
    complete_trials,
    objective_in_words,
    preset_trial,
    training_in_words,
)
from sb3_piano.tuning.outcome.commands import train_command, zoo_command
from sb3_piano.tuning.outcome.figures import study_figures
from sb3_piano.tuning.outcome.table import RESULTS, STATES
from sb3_piano.tuning.outcome.zoo_entry import zoo_entry
from sb3_piano.tuning.search_space.defaults import with_defaults
from sb3_piano.tuning.search_space.entry_paths import MISSING, setting_at
from sb3_piano.tuning.study_config import StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder
from sb3_piano.viewing.report.page import render

MOST_TRIALS = 10
"""Trials in the table of the best ones."""

_NOTHING = "\N{EN DASH}"
_GONE = "its process ended without a word: killed, or out of memory"


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
    trials, best = counting(study), best_trial(study)
    counts = Counter(trial.state for trial in trials)
    return render(
        "study.html",
        title=study.study_name,
        subject=_subject(config),
        caveat=CAVEAT,
        trials=len(trials),
        states=[f"{counts[state]} {name}" for state, name in STATES.items() if counts[state]],
        complete=counts[TrialState.COMPLETE],
        repeated=len(repeated(study.get_trials(deepcopy=False))),
        best=best,
        preset=preset_trial(study),
        settings=[] if best is None else _settings(best, config),
        results=RESULTS,
        searched=list(config.space),
        best_trials=[_row(trial, config) for trial in _best_first(study)[:MOST_TRIALS]],
        failures=[
            (trial.number, trial.user_attrs.get(FAILURE, _GONE))
            for trial in trials
            if trial.state is TrialState.FAIL
        ],
        **study_figures(study, label),
        facts=[("Value", objective_in_words(config)), ("Training", training_in_words(config))],
        commands=_commands(study, config, StudyFolder(Path()) if folder is None else folder),
    )


def _subject(config: StudyConfig) -> str:
    env_id = registered_id(config.env_id)[1]
    score = {**gym.spec(env_id).kwargs, **config.config.env_kwargs}.get("score")
    piece = f" · {Path(score).stem}" if isinstance(score, str) else ""
    return f"Study of {config.algo.upper()} · {env_id}{piece}"


def _best_first(study: optuna.Study) -> list[FrozenTrial]:
    return sorted(complete_trials(study), key=lambda t: (-(t.value or 0.0), t.number))


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
        trial.user_attrs.get(ORIGIN, ""),
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
    commands = []
    entry = best_entry(study, config)
    if entry is not None:
        written, left_out = zoo_entry(config.algo, config.env_id, entry)
        kwargs = written.get("env_kwargs", {})
        commands = [
            ("Train", train_command(config, folder.best_file, left_out.get("vec_env"))),
            ("Train in RL Zoo", zoo_command(config, folder.best_file, kwargs)),
        ]
    journal = folder.journal_file
    store = shlex.quote(str(journal)) if folder.path == Path() or journal.exists() else "URL"
    return [*commands, ("Look closer", f"optuna-dashboard {store}")]
