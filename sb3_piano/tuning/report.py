"""Reports of a study: a page with Optuna's figures that needs no network, and a CSV table."""

from __future__ import annotations

import shlex
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import gymnasium as gym
import optuna
import plotly.graph_objects as go
from optuna import visualization
from optuna.importance import PedAnovaImportanceEvaluator
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
from sb3_piano.tuning.objective import RESULTS
from sb3_piano.tuning.space import MISSING, setting_at, with_defaults
from sb3_piano.tuning.study import StudyConfig, StudyFolder
from sb3_piano.tuning.trials import STATES
from sb3_piano.viewing.report.page import PALETTE, render

MOST_TRIALS = 10
"""Trials in the table of the best ones."""
REPEATED = "repeated"
"""The state of a trial that does not count, as another one has its settings."""

_NOTHING = "\N{EN DASH}"
_BLUE = PALETTE["index-finger"]
_STATE_COLORS = {
    TrialState.COMPLETE: PALETTE["sounding"],
    TrialState.PRUNED: PALETTE["little-finger"],
    TrialState.FAIL: PALETTE["thumb"],
    TrialState.RUNNING: _BLUE,
    TrialState.WAITING: PALETTE["rule"],
}
_AXIS_WIDTH = 106
"""Of a parallel coordinate plot, in pixels."""
_LONGEST = 18
"""Characters of a choice that have room there."""


def write_table(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> Path:
    """Write a row for each trial into the study's folder, and return the file.

    ``value`` is, of a pruned trial, the last one that it reported. Settings stand as the training
    got them. What a trial does not have is left empty.
    """
    found = study.get_trials(deepcopy=False)
    again = trials.repeated(found)
    before = (*RESULTS, trials.STEPS, trials.SECONDS, trials.ORIGIN)
    after = (trials.HOST, trials.FOLDER)
    rows = (
        {
            **{name: trial.user_attrs.get(name) for name in (*before, *after)},
            **config.space.settings(trial.params),
            "number": trial.number,
            "state": REPEATED if trial.number in again else STATES[trial.state],
            "value": trial.value,
            trials.FAILURE: trials.failure_of(trial),
        }
        for trial in found
    )
    columns = ("number", "state", "value", *before, *config.space, trials.FAILURE, *after)
    write_csv(folder.table_file, columns, rows)
    return folder.table_file


def write_report(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> Path:
    """Write the report into the study's folder, and return the file."""
    write_text(folder.report_file, report_html(study, config, folder))
    return folder.report_file


def report_html(study: optuna.Study, config: StudyConfig, folder: StudyFolder | None = None) -> str:
    """Return the page of a study, whatever it holds so far.

    The commands on it are for its folder, by default the present one.
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


# Optuna's figures.


def study_figures(study: optuna.Study, label: str) -> dict[str, Any]:
    """Return the figures of a study; ``None`` for those for which it has nothing to show yet.

    They are ``history``, ``importance``, ``reports``, ``timeline``, ``parallel``, and ``slices``:
    one for each parameter that complete trials have, the most important one first. ``label`` is
    what a value is called.
    """
    every, complete = study.get_trials(deepcopy=False), trials.best_first(study)
    searched = sorted({name for trial in complete for name in trial.params})
    shares = importances(study)
    slices = sorted(searched, key=lambda name: (-shares.get(name, 0.0), name))
    return {
        "history": _history(study, label) if complete else None,
        "importance": _importance(study, shares) if shares else None,
        "reports": _reports(study, label) if any(t.intermediate_values for t in every) else None,
        "timeline": _timeline(study, len(every)) if every else None,
        "parallel": _parallel(study, label, len(searched)) if searched else None,
        "slices": {name: _slice(study, label, name) for name in slices},
    }


def importances(study: optuna.Study) -> dict[str, float]:
    """Return how much each parameter matters for being among the best tenth of complete trials.

    They are those of Optuna's PED-ANOVA evaluator, which does not draw random numbers; they sum up
    to 1. Without two different values there are none.
    """
    if len({trial.value for trial in trials.best_first(study)}) < 2:
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of few trials, which the page says too
        evaluator = PedAnovaImportanceEvaluator()
        found = optuna.importance.get_param_importances(study, evaluator=evaluator)
    return found if sum(found.values()) > 0 else {}


def _history(study: optuna.Study, label: str) -> go.Figure:
    figure = visualization.plot_optimization_history(study, target_name=label)
    figure.update_traces(marker={"color": _BLUE, "size": 7}, selector={"name": label})
    line = {"color": PALETTE["sounding"], "width": 2, "shape": "hv"}
    figure.update_traces(line=line, name="best so far", selector={"name": "Best Value"})
    preset = trials.preset_trial(study)
    if preset is not None:
        line = {"color": PALETTE["muted"], "dash": "dash"}
        figure.add_hline(preset.value, line=line, name="preset", showlegend=True)
    return figure.update_layout(height=300, showlegend=True)


def _importance(study: optuna.Study, shares: dict[str, float]) -> go.Figure:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        evaluator = PedAnovaImportanceEvaluator()
        figure = visualization.plot_param_importances(study, evaluator=evaluator)
    figure.update_traces(marker={"color": _BLUE})
    figure.update_layout(height=max(300, 80 + 26 * len(shares)))
    figure.update_xaxes(title=None, range=[0, 1.15 * max(shares.values())])
    return figure.update_yaxes(title=None, showgrid=False)


def _reports(study: optuna.Study, label: str) -> go.Figure:
    """Return what trials reported while they ran."""
    figure = visualization.plot_intermediate_values(study)
    pruned = study.get_trials(deepcopy=False, states=(TrialState.PRUNED,))
    names = {f"Trial{trial.number}" for trial in pruned}
    for trace in figure.data:
        is_pruned = trace.name in names
        color = _STATE_COLORS[TrialState.PRUNED if is_pruned else TrialState.COMPLETE]
        line = {"color": color, "dash": "dot" if is_pruned else "solid", "width": 1.4}
        trace.update(line=line, marker={"size": 5}, opacity=0.7)
    figure.update_layout(height=320, yaxis_title_text=label)
    return figure.update_xaxes(title_text="environment steps of the trial", rangemode="tozero")


def _parallel(study: optuna.Study, label: str, n_parameters: int) -> go.Figure:
    """Return lines through the settings of complete trials.

    ``meta`` is the least width in pixels at which its axes can be told apart.
    """
    figure = visualization.plot_parallel_coordinate(study, target_name=label)
    margin, width = {"l": 50, "r": 30, "t": 30, "b": 50}, _AXIS_WIDTH * (n_parameters + 1)
    figure.update_layout(height=340, margin=margin, meta=width)
    figure.update_traces(marker={"showscale": False})  # the first axis has the values
    for tick in figure.layout.annotations:
        if len(tick.text) > _LONGEST:
            tick.text = f"…{tick.text[1 - _LONGEST :]}"
    return figure.update_xaxes(tickfont={"size": 10})


def _slice(study: optuna.Study, label: str, name: str) -> go.Figure:
    """Return values of complete trials over one of their settings."""
    figure = visualization.plot_slice(study, params=[name], target_name=label)
    figure.update_traces(marker={"showscale": False, "size": 7})
    figure.update_layout(height=230).update_xaxes(title=None, nticks=6)
    if figure.layout.xaxis.type == "log":
        figure.update_xaxes(dtick="D2", exponentformat="none")  # 1, 2 and 5 of each decade
    return figure


def _timeline(study: optuna.Study, n_trials: int) -> go.Figure:
    """Return when each trial ran, by its state."""
    figure = visualization.plot_timeline(study)
    for trace in figure.data:
        state = TrialState[trace.name]
        trace.update(name=STATES[state], marker={"color": _STATE_COLORS[state]})
    figure.update_layout(height=max(220, 90 + 9 * n_trials), showlegend=True)
    # Labels of times that widened a margin could change the ticks, and these the labels, in turn.
    figure.update_xaxes(title=None, automargin="height")
    return figure.update_yaxes(title_text="trial", showgrid=False)
