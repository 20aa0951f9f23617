"""How the metrics went over the training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from sb3_piano.viewing.report.definitions import definition_of
from sb3_piano.viewing.report.rewards import NOTHING, NOTHING_COLOR, RETURN_PREFIX
from sb3_piano.viewing.report.theme import INK, PAPER, RULE, SERIES, SOUNDING, axis, themed

MOST_POINTS = 400
"""Points of a curve that are drawn; of a longer one, means of neighbours are."""

_TRAINING, _EVALUATION = "training", "evaluation"
_REWARD_TAGS = "reward/"


class Curve(NamedTuple):
    """A number over the training."""

    steps: npt.NDArray[np.int64]
    """(n,) environment steps, ascending."""
    values: npt.NDArray[np.float64]
    """(n,)"""


class Panel(NamedTuple):
    """Curves that share a figure."""

    title: str
    curves: tuple[tuple[str, str], ...]
    """Name in the log, and what the curve is called in the figure."""
    metric: str
    """The metric of an episode that is shown, whose baseline is drawn as a line; or empty."""


_PANELS = (
    Panel("F1", (("music/f1", _TRAINING), ("eval/f1", _EVALUATION)), "f1"),
    Panel(
        "Onset F1",
        (("music/onset_f1", _TRAINING), ("eval/onset_f1", _EVALUATION)),
        "onset_f1",
    ),
    Panel(
        "Return",
        (("rollout/ep_rew_mean", _TRAINING), ("eval/mean_reward", _EVALUATION)),
        "return",
    ),
)
_SHARES = ("f1", "onset_f1")


def training_figures(
    curves: Mapping[str, Curve], baseline: Mapping[str, float] | None
) -> dict[str, go.Figure]:
    """Return a figure for each of F1, onset F1, return and reward terms that the log knows.

    Args:
        curves: The log, by name (``music/f1``, ``rollout/ep_rew_mean``, ``reward/energy``, ...).
        baseline: Metrics of an episode in which the hands rest, if there is one.

    Returns:
        The figures by title, none of them empty.
    """
    figures = {}
    for panel in (*_PANELS, _reward_panel(curves)):
        known = [(curves[tag], label) for tag, label in panel.curves if _drawable(curves, tag)]
        if known:
            level = None if baseline is None else baseline.get(panel.metric)
            figures[panel.title] = _figure(known, level, in_unit=panel.metric in _SHARES)
    return figures


def _drawable(curves: Mapping[str, Curve], tag: str) -> bool:
    return tag in curves and len(curves[tag].steps) > 0


def _reward_panel(curves: Mapping[str, Curve]) -> Panel:
    tags = [tag for tag in curves if tag.startswith(_REWARD_TAGS)]
    labels = [definition_of(RETURN_PREFIX + tag.removeprefix(_REWARD_TAGS)).label for tag in tags]
    return Panel("Reward terms", tuple(zip(tags, labels, strict=True)), "")


def _figure(curves: list[tuple[Curve, str]], level: float | None, in_unit: bool) -> go.Figure:
    figure = go.Figure(layout=_layout(in_unit))
    for number, (curve, label) in enumerate(curves):
        thin = thinned(curve)
        few = len(thin.steps) <= 40
        figure.add_scatter(
            x=thin.steps,
            y=thin.values,
            mode="lines+markers" if few else "lines",
            line={"color": _color(label, number), "width": 2},
            marker={"size": 5},
            hovertemplate=f"{label}: %{{y:.3f}}<extra></extra>",
            name=label,
        )
    if level is not None:
        last = max(float(curve.steps[-1]) for curve, _ in curves)
        figure.add_scatter(
            x=[0.0, last],
            y=[level, level],
            mode="lines",
            line={"color": NOTHING_COLOR, "width": 2, "dash": "dash"},
            hovertemplate=f"{NOTHING}: %{{y:.3f}}<extra></extra>",
            name=NOTHING,
        )
    return figure


def _color(label: str, number: int) -> str:
    kinds = {_TRAINING: SOUNDING, _EVALUATION: INK}
    return kinds.get(label) or SERIES[number % len(SERIES)]


def thinned(curve: Curve, most: int = MOST_POINTS) -> Curve:
    """Return means of equally many neighbouring points, so that there are at most so many.

    Args:
        curve: n points.
        most: At least 1.
    """
    each = -(-len(curve.steps) // most)
    if each <= 1:
        return curve
    starts = np.arange(0, len(curve.steps), each)
    counts = np.diff(starts, append=len(curve.steps))
    return Curve(
        steps=np.add.reduceat(curve.steps, starts) // counts,
        values=np.add.reduceat(curve.values, starts) / counts,
    )


def _layout(in_unit: bool) -> go.Layout:
    return themed(
        height=250,
        margin={"l": 40, "r": 16, "t": 30, "b": 40},
        hovermode="x unified",
        hoverlabel={"bgcolor": PAPER, "bordercolor": RULE, "font": {"color": INK}},
        showlegend=True,
        xaxis=axis(rangemode="tozero", title={"text": "environment steps"}, nticks=6),
        yaxis=axis(range=[0, 1.02] if in_unit else None, nticks=6),
    )
