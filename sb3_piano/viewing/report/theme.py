"""How all figures of a report look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from sb3_piano.viewing.colors import FINGER_COLORS, PRESSED_COLOR, UNLABELLED_COLOR

INK, MUTED, RULE, PAPER, SHADE = "#22252b", "#666b73", "#e4e2dc", "#ffffff", "#f3f1ec"
"""Text, text in the background, lines, the ground, and the rows of black keys."""

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"

_CONFIG = {
    "displaylogo": False,
    "displayModeBar": False,
    "responsive": True,
    "doubleClick": "reset",
}


def css_color(rgba: Sequence[float], alpha: float = 1.0) -> str:
    """Return a colour as CSS writes it.

    >>> css_color((1.0, 0.5, 0.0, 1.0), alpha=0.25)
    'rgba(255,128,0,0.25)'

    Args:
        rgba: Red, green and blue in [0, 1]; a fourth number is ignored.
        alpha: Opacity in [0, 1].
    """
    red, green, blue = (round(255 * part) for part in rgba[:3])
    return f"rgba({red},{green},{blue},{alpha:g})"


def finger_color(finger: int, alpha: float = 1.0) -> str:
    """Return the colour of a finger label, -1 included."""
    return css_color(FINGER_COLORS[finger] if finger >= 0 else UNLABELLED_COLOR, alpha)


SOUNDING = css_color(PRESSED_COLOR)
"""The colour of what is played as it should be."""

SERIES = (*(css_color(FINGER_COLORS[finger]) for finger in (0, 1, 3, 4)), INK)
"""Colours of lines that are no fingers: the palette's without its yellow, too pale for a line."""


def themed(**layout: Any) -> go.Layout:
    """Return a layout of the common look, with these settings on top."""
    common = go.Layout(
        template="none",
        font={"family": FONT, "size": 12, "color": INK},
        paper_bgcolor=PAPER,
        plot_bgcolor=PAPER,
        hoverlabel={
            "bgcolor": INK,
            "bordercolor": INK,
            "align": "left",
            "font": {"family": FONT, "size": 13, "color": PAPER},
        },
        showlegend=False,
        dragmode=False,
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0, "xanchor": "left"},
    )
    return common.update(layout)


def axis(**settings: Any) -> dict[str, Any]:
    """Return an axis with faint lines, with these settings on top."""
    common = {
        "gridcolor": RULE,
        "zeroline": False,
        "linecolor": RULE,
        "tickfont": {"size": 11, "color": MUTED},
        "fixedrange": True,
        "automargin": True,
    }
    if "title" in settings:
        settings["title"] = {"font": {"size": 12, "color": MUTED}, **settings["title"]}
    return {**common, **settings}


def figure_html(figure: go.Figure, name: str) -> str:
    """Return the HTML of a figure, to stand after :func:`library_html`.

    Args:
        figure: The figure; its texts may hold anything, they are escaped.
        name: The id of its element.
    """
    html: str = figure.to_html(
        full_html=False, include_plotlyjs=False, include_mathjax=False, div_id=name, config=_CONFIG
    )
    return html


def library_html() -> str:
    """Return the script element that holds the plotting library."""
    return f"<script>{get_plotlyjs()}</script>"
