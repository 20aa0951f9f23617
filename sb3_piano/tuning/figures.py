"""Optuna's figures of a study; how they look in a report is up to its script."""

from __future__ import annotations

import warnings
from typing import Any

import optuna
import plotly.graph_objects as go
from optuna import visualization
from optuna.importance import PedAnovaImportanceEvaluator
from optuna.trial import TrialState

from sb3_piano.tuning.trials import complete_trials, preset_trial
from sb3_piano.viewing.report.page import PALETTE

STATES = {
    TrialState.COMPLETE: "complete",
    TrialState.PRUNED: "pruned",
    TrialState.FAIL: "failed",
    TrialState.RUNNING: "running",
    TrialState.WAITING: "waiting",
}
"""States as users read them."""

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


def study_figures(study: optuna.Study, label: str) -> dict[str, Any]:
    """Return the figures of a study; ``None`` for those for which it has nothing to show yet.

    Args:
        study: The study.
        label: What a value is called.

    Returns:
        ``history``, ``importance``, ``reports``, ``timeline``, ``parallel``, and ``slices``: one
        figure for each parameter that complete trials have, the most important one first.
    """
    complete = complete_trials(study)
    searched = sorted({name for trial in complete for name in trial.params})
    shares = importances(study)
    slices = sorted(searched, key=lambda name: (-shares.get(name, 0.0), name))
    return {
        "history": _history(study, label) if complete else None,
        "importance": _importance(study, shares) if shares else None,
        "reports": _reports(study, label),
        "timeline": _timeline(study) if study.get_trials(deepcopy=False) else None,
        "parallel": _parallel(study, label, len(searched)) if searched else None,
        "slices": {name: _slice(study, label, name) for name in slices},
    }


def importances(study: optuna.Study) -> dict[str, float]:
    """Return how much each parameter matters for being among the best tenth of complete trials.

    They are those of Optuna's PED-ANOVA evaluator, which does not draw random numbers; they sum up
    to 1. Without two different values there are none.
    """
    if len({trial.value for trial in complete_trials(study)}) < 2:
        return {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of few trials, which the page says too
        evaluator = PedAnovaImportanceEvaluator()
        found = optuna.importance.get_param_importances(study, evaluator=evaluator)
    return found if sum(found.values()) > 0 else {}


def _history(study: optuna.Study, label: str) -> go.Figure:
    figure = visualization.plot_optimization_history(study, target_name=label)
    figure.update_traces(marker={"color": _BLUE, "size": 7}, selector={"name": label})
    figure.update_traces(
        line={"color": PALETTE["sounding"], "width": 2, "shape": "hv"},
        name="best so far",
        selector={"name": "Best Value"},
    )
    preset = preset_trial(study)
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


def _reports(study: optuna.Study, label: str) -> go.Figure | None:
    """Return what trials reported while they ran; ``None`` if nothing."""
    figure = visualization.plot_intermediate_values(study)
    if not figure.data:
        return None
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
    figure.update_layout(
        height=340,
        margin={"l": 50, "r": 30, "t": 30, "b": 50},
        meta=_AXIS_WIDTH * (n_parameters + 1),
    )
    figure.update_traces(marker={"showscale": False})  # the first axis has the values
    figure.for_each_annotation(lambda tick: tick.update(text=_shortened(tick.text)))
    return figure.update_xaxes(tickfont={"size": 10})


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"…{text[1 - _LONGEST :]}"


def _slice(study: optuna.Study, label: str, name: str) -> go.Figure:
    """Return values of complete trials over one of their settings."""
    figure = visualization.plot_slice(study, params=[name], target_name=label)
    figure.update_traces(marker={"showscale": False, "size": 7})
    figure.update_layout(height=230).update_xaxes(title=None, nticks=6)
    if figure.layout.xaxis.type == "log":
        figure.update_xaxes(dtick="D2", exponentformat="none")  # 1, 2 and 5 of each decade
    return figure


def _timeline(study: optuna.Study) -> go.Figure:
    """Return when each trial ran, by its state."""
    figure = visualization.plot_timeline(study)
    figure.for_each_trace(
        lambda trace: trace.update(
            name=STATES[TrialState[trace.name]],
            marker={"color": _STATE_COLORS[TrialState[trace.name]]},
        )
    )
    n_trials = len(study.get_trials(deepcopy=False))
    figure.update_layout(height=max(220, 90 + 9 * n_trials), showlegend=True)
    figure.update_xaxes(title=None)
    return figure.update_yaxes(title_text="trial", showgrid=False)
