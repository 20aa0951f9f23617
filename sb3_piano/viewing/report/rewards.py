"""What each reward term earned in the episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import plotly.graph_objects as go

from sb3_piano.viewing.report.definitions import definition_of, formatted
from sb3_piano.viewing.report.theme import SOUNDING, axis, themed

RETURN_PREFIX = "return_"
"""Begins the name of the episode's sum of a weighted reward term, in ``info``."""

PLAYED, NOTHING = "played", "playing nothing"
"""What the two kinds of bars and lines are called: the policy, and hands that rest."""

NOTHING_COLOR = "#c9c6be"
"""The colour of what playing nothing scores."""


def reward_terms_figure(
    metrics: Mapping[str, float], baseline: Mapping[str, float] | None
) -> go.Figure | None:
    """Return bars of the episode's sum of each weighted reward term, the policy beside resting.

    Args:
        metrics: Has the sums under names that begin with ``return_``.
        baseline: The same of an episode in which the hands rest, if there is one.

    Returns:
        The figure; ``None`` if there are no such names.
    """
    terms = [name for name in metrics if name.startswith(RETURN_PREFIX)]
    if not terms:
        return None
    episodes = [(PLAYED, metrics, SOUNDING)]
    if baseline is not None:
        episodes.append((NOTHING, baseline, NOTHING_COLOR))
    every = [sums[name] for _, sums, _ in episodes for name in terms]
    figure = go.Figure(layout=_layout(len(every), every))
    for who, sums, color in episodes:
        figure.add_bar(
            orientation="h",
            y=[definition_of(name).label for name in terms],
            x=[sums[name] for name in terms],
            text=[formatted(name, sums[name]) for name in terms],
            textposition="outside",
            cliponaxis=False,
            marker={"color": color},
            hovertemplate=f"%{{y}}, {who}: %{{text}}<extra></extra>",
            name=who,
        )
    return figure


def _layout(bars: int, sums: Sequence[float]) -> go.Layout:
    return themed(
        height=110 + 21 * bars,
        margin={"l": 90, "r": 56, "t": 26, "b": 34},
        hovermode="closest",
        bargap=0.35,
        bargroupgap=0.08,
        showlegend=True,
        xaxis=axis(nticks=6, range=_range_with_room(sums)),
        yaxis=axis(autorange="reversed", showgrid=False),
    )


def _range_with_room(sums: Sequence[float]) -> list[float]:
    """Return a range in which the numbers fit beside the bars."""
    low, high = min(0.0, *sums), max(0.0, *sums)
    room = 0.25 * (high - low)
    return [low - (room if low < 0 else 0), high + room]
