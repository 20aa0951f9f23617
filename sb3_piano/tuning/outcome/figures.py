"""Optuna's figures of a study; how they look in a report is up to its script."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Iterator
from typing import Any

import optuna
import plotly.graph_objects as go
from optuna import visualization
from optuna.importance import PedAnovaImportanceEvaluator
from optuna.trial import TrialState

from sb3_piano.tuning.outcome.best import complete_trials, preset_trial
from sb3_piano.tuning.outcome.table import STATES
from sb3_piano.viewing.report.page import PALETTE

_BEST = "Best Value"
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
    return {
        "history": _history(study, label),
        "importance": _importance(study),
        "reports": _reports(study, label),
        "timeline": _timeline(study),
        "parallel": _parallel(study, label),
        "slices": _slices(study, label),
    }


def _history(study: optuna.Study, label: str) -> go.Figure | None:
    """Return the values of the complete trials; ``None`` if there are none."""
    if not complete_trials(study):
        return None
    figure = visualization.plot_optimization_history(study, target_name=label)
    figure.update_traces(marker={"color": _BLUE, "size": 7}, selector={"name": label})
    figure.update_traces(
        line={"color": PALETTE["sounding"], "width": 2, "shape": "hv"},
        name="best so far",
        selector={"name": _BEST},
    )
    preset = preset_trial(study)
    if preset is not None:
        figure.add_hline(
            preset.value,
            line={"color": PALETTE["muted"], "dash": "dash"},
            name="preset",
            showlegend=True,
        )
    return figure.update_layout(height=300, showlegend=True)


def importances(study: optuna.Study) -> dict[str, float]:
    """Return how much each parameter matters for being among the best tenth of complete trials.

    They are those of Optuna's PED-ANOVA evaluator, which does not draw random numbers; they sum up
    to 1. Without two different values there are none.
    """
    if len({trial.value for trial in complete_trials(study)}) < 2:
        return {}
    with _quiet():
        evaluator = PedAnovaImportanceEvaluator()
        found = optuna.importance.get_param_importances(study, evaluator=evaluator)
    return found if sum(found.values()) > 0 else {}


def _importance(study: optuna.Study) -> go.Figure | None:
    """Return bars of :func:`importances`; ``None`` if there are none."""
    found = importances(study)
    if not found:
        return None
    with _quiet():
        evaluator = PedAnovaImportanceEvaluator()
        figure = visualization.plot_param_importances(study, evaluator=evaluator)
    figure.update_traces(marker={"color": _BLUE})
    figure.update_layout(height=max(300, 80 + 26 * len(found)))
    figure.update_xaxes(title=None, range=[0, 1.15 * max(found.values())])
    return figure.update_yaxes(title=None, showgrid=False)


def _reports(study: optuna.Study, label: str) -> go.Figure | None:
    """Return what trials reported while they ran; ``None`` if nothing."""
    figure = visualization.plot_intermediate_values(study)
    if not figure.data:
        return None
    pruned = {f"Trial{t.number}" for t in study.get_trials(deepcopy=False)
              if t.state is TrialState.PRUNED}  # fmt: skip
    for trace in figure.data:
        is_pruned = trace.name in pruned
        trace.update(
            line={
                "color": _STATE_COLORS[TrialState.PRUNED if is_pruned else TrialState.COMPLETE],
                "dash": "dot" if is_pruned else "solid",
                "width": 1.4,
            },
            marker={"size": 5},
            opacity=0.7,
        )
    figure.update_layout(height=320, yaxis_title_text=label)
    return figure.update_xaxes(title_text="environment steps of the trial", rangemode="tozero")


def _parallel(study: optuna.Study, label: str) -> go.Figure | None:
    """Return lines through the settings of complete trials; ``None`` if there are none.

    ``meta`` is the least width in pixels at which its axes can be told apart.
    """
    names = _searched(study)
    if not names:
        return None
    figure = visualization.plot_parallel_coordinate(study, target_name=label)
    figure.update_layout(
        height=340,
        margin={"l": 50, "r": 30, "t": 30, "b": 50},
        meta=_AXIS_WIDTH * (len(names) + 1),
    )
    figure.update_traces(marker={"showscale": False})  # the first axis has the values
    figure.for_each_annotation(lambda tick: tick.update(text=_shortened(tick.text)))
    return figure.update_xaxes(tickfont={"size": 10})


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"…{text[1 - _LONGEST :]}"


def _slices(study: optuna.Study, label: str) -> dict[str, go.Figure]:
    """Return a figure of values over settings for each parameter of complete trials, by its name.

    The most important one comes first.
    """
    names = _searched(study)
    order = importances(study)
    figures = {}
    for name in sorted(names, key=lambda name: (-order.get(name, 0.0), name)):
        figure = visualization.plot_slice(study, params=[name], target_name=label)
        figure.update_traces(marker={"showscale": False, "size": 7})
        figure.update_layout(height=230).update_xaxes(title=None, nticks=6)
        if figure.layout.xaxis.type == "log":
            ticks = log_ticks(min(figure.data[0].x), max(figure.data[0].x))
            figure.update_xaxes(tickvals=ticks, ticktext=[f"{tick:g}" for tick in ticks])
        figures[name] = figure
    return figures


def log_ticks(low: float, high: float) -> list[float]:
    """Return the numbers to mark on a logarithmic axis: 1, 2 and 5, or 1 alone, of each decade.

    >>> log_ticks(0.0008, 0.012)
    [0.001, 0.002, 0.005, 0.01]

    Args:
        low: The least number that is shown, above 0.
        high: The greatest.
    """
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = (1, 2, 5) if len(decades) <= 4 else (1,)
    ticks = [float(f"{step}e{decade}") for decade in decades for step in steps]
    return [tick for tick in ticks if low <= tick <= high]


def _timeline(study: optuna.Study) -> go.Figure | None:
    """Return when each trial ran, by its state; ``None`` if there are no trials."""
    trials = study.get_trials(deepcopy=False)
    if not trials:
        return None
    figure = visualization.plot_timeline(study)
    figure.for_each_trace(
        lambda trace: trace.update(
            name=STATES[TrialState[trace.name]],
            marker={"color": _STATE_COLORS[TrialState[trace.name]]},
        )
    )
    figure.update_layout(height=max(220, 90 + 9 * len(trials)), showlegend=True)
    figure.update_xaxes(title=None)
    return figure.update_yaxes(title_text="trial", showgrid=False)


def _searched(study: optuna.Study) -> list[str]:
    """Return the parameters that complete trials have."""
    return sorted({name for trial in complete_trials(study) for name in trial.params})


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep to ourselves that an evaluator is experimental, or has few trials; the page says so."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
