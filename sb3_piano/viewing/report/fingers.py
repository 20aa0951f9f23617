"""How the pressing is shared among the ten fingers."""

from __future__ import annotations

from collections.abc import Mapping

import plotly.graph_objects as go

from sb3_piano.metrics import FINGER_SHARES, finger_shares
from sb3_piano.music import FINGER_NAMES
from sb3_piano.performance import Performance
from sb3_piano.viewing.report.theme import MUTED, axis, finger_color, themed

# As the hands lie on the keyboard: the left one's little finger is the leftmost.
_LEFT_TO_RIGHT = (9, 8, 7, 6, 5, 0, 1, 2, 3, 4)
_PLACES = (-5, -4, -3, -2, -1, 1, 2, 3, 4, 5)


def finger_usage_figure(performance: Performance, metrics: Mapping[str, float]) -> go.Figure:
    """Return bars of the shares of the pressing, beside what the score's fingering asks for.

    Args:
        performance: What was played; its roll has the fingering.
        metrics: The shares that were played, by their names in ``FINGER_SHARES``.
    """
    played = [100 * metrics[FINGER_SHARES[finger]] for finger in _LEFT_TO_RIGHT]
    labels = finger_shares(performance.roll.finger[: len(performance)])
    asked = [100 * labels[finger] for finger in _LEFT_TO_RIGHT]
    names = [FINGER_NAMES[finger] for finger in _LEFT_TO_RIGHT]
    figure = go.Figure(layout=_layout())
    if labels.sum() > 0:
        figure.add_bar(
            x=_PLACES,
            y=asked,
            width=0.84,
            marker={
                "color": [finger_color(finger, 0.16) for finger in _LEFT_TO_RIGHT],
                "line": {"width": 2, "color": [finger_color(f) for f in _LEFT_TO_RIGHT]},
            },
            customdata=names,
            hovertemplate="%{customdata}: the fingering asks for %{y:.1f} %<extra></extra>",
            name="due",
        )
    figure.add_bar(
        x=_PLACES,
        y=played,
        width=0.46,
        marker={"color": [finger_color(finger) for finger in _LEFT_TO_RIGHT]},
        customdata=names,
        hovertemplate="%{customdata}: %{y:.1f} % of the pressing<extra></extra>",
        name="played",
    )
    return figure


def _layout() -> go.Layout:
    hands = [
        {"x": x, "y": -0.2, "yref": "paper", "text": text, "showarrow": False}
        | {"font": {"size": 12, "color": MUTED}}
        for x, text in ((-3, "left hand"), (3, "right hand"))
    ]
    ticks = [str(finger % 5 + 1) for finger in _LEFT_TO_RIGHT]
    return themed(
        height=290,
        margin={"l": 44, "r": 12, "t": 8, "b": 54},
        annotations=hands,
        barmode="overlay",
        hovermode="closest",
        xaxis=axis(tickvals=_PLACES, ticktext=ticks, showgrid=False, range=[-5.7, 5.7]),
        yaxis=axis(ticksuffix=" %", rangemode="tozero", nticks=5),
    )
