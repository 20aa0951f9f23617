"""The tables of a study's report, as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import optuna
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.tuning.attributes import FAILURE, ORIGIN, counting
from sb3_piano.tuning.outcome.best import best_trial, complete_trials
from sb3_piano.tuning.outcome.table import RESULTS
from sb3_piano.tuning.search_space.defaults import with_defaults
from sb3_piano.tuning.search_space.entry_paths import MISSING, setting_at
from sb3_piano.tuning.study_config import StudyConfig

MOST_TRIALS = 10
"""Trials in the table of the best ones."""

_NOTHING = "\N{EN DASH}"
_GONE = "its process ended without a word: killed, or out of memory"


def settings_table(study: optuna.Study, config: StudyConfig) -> str:
    """Return the best settings beside the preset's; nothing if no trial is complete."""
    best = best_trial(study)
    if best is None:
        return ""
    found = config.space.settings(best.params)
    preset = with_defaults(config.algo, config.env_id, config.entry)
    rows = (
        (name, shown(found.get(name, MISSING)), shown(setting_at(preset, name)))
        for name in config.space
    )
    return _wide(_table(("setting", "best", "preset"), rows))


def best_trials_table(study: optuna.Study, config: StudyConfig) -> str:
    """Return the best complete trials, the best one first."""
    trials = sorted(complete_trials(study), key=lambda t: (-(t.value or 0.0), t.number))
    heads = (
        "trial",
        "value",
        *(name.replace("_", " ") for name in RESULTS),
        *config.space,
        "origin",
    )
    return _wide(_table(heads, (_row(trial, config) for trial in trials[:MOST_TRIALS])))


def _row(trial: FrozenTrial, config: StudyConfig) -> tuple[str, ...]:
    settings = config.space.settings(trial.params)
    return (
        str(trial.number),
        *(_decimal(value) for value in (trial.value, *map(trial.user_attrs.get, RESULTS))),
        *(shown(settings.get(name, MISSING)) for name in config.space),
        str(trial.user_attrs.get(ORIGIN, "")),
    )


def failures_table(study: optuna.Study) -> str:
    """Return the trials that failed, with the reasons; nothing if there are none."""
    failed = [trial for trial in counting(study) if trial.state is TrialState.FAIL]
    rows = ((str(t.number), str(t.user_attrs.get(FAILURE, _GONE))) for t in failed)
    return _table(("trial", "reason"), rows) if failed else ""


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


def _decimal(value: float | None) -> str:
    return _NOTHING if value is None else f"{value:.3f}"


def _wide(table: str) -> str:
    """Return a table that is scrolled where it does not fit."""
    return f'<div class="wide">{table}</div>'


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    def cells(tag: str, texts: Sequence[str]) -> str:
        return "".join(f"<{tag}>{escape(text)}</{tag}>" for text in texts)

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"
