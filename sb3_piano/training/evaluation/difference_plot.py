"""Plot of a comparison: sorted differences of its pairs, one panel per metric."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sb3_piano.exceptions import ConfigError
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.training.evaluation.statistics import CONFIDENCE

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sb3_piano.training.evaluation.comparison import Comparison, MetricComparison

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
"""Supported suffixes of a picture's name."""

MOST_NAMED = 30
"""Greatest number of pairs with legible names beside their bars."""

_MOST_APART = 100
"""Greatest number of bars with gaps; with more, gaps would be below a pixel."""

_COLUMNS = 2
"""Greatest number of panels in a row."""
_WIDTH = 5.0  # of a panel [inch]
_LINE, _MARGINS = 0.2, 1.2  # height of a named bar, and of the margins [inch]
_HEIGHT = 5.0  # of a panel without names [inch]
_LETTERS_PER_INCH = 11
_LONGEST_NAME = 32

# From the colour-blind-safe palette of Okabe and Ito.
_ABOVE, _BELOW, _EQUAL, _MEAN, _BAND = "#0072b2", "#d55e00", "#666666", "#222222", "#dddddd"

_LEGEND = (
    "B above A",
    "B below A",
    "equal",
    "mean difference",
    f"its {100 * CONFIDENCE:g} % interval",
)
_IS_ABOVE, _IS_BELOW, _IS_EQUAL, _IS_MEAN, _IS_INTERVAL = _LEGEND


def picture_format(path: Path) -> str:
    """Return the format of a picture's suffix, such as ``"png"``.

    Raises:
        ConfigError: If the suffix is not in :data:`PICTURE_SUFFIXES`.
    """
    suffix = path.suffix.lower()
    if suffix not in PICTURE_SUFFIXES:
        raise ConfigError(
            f"Cannot tell the format of the picture '{path}': expected a name that ends in "
            f"{', '.join(PICTURE_SUFFIXES[:-1])} or {PICTURE_SUFFIXES[-1]}."
        )
    return suffix.removeprefix(".")


def difference_plot(comparison: Comparison) -> Figure:
    """Plot the differences B - A of the pairs as sorted bars, with their mean and its interval.

    Each metric is sorted separately, the largest difference on top. Up to :data:`MOST_NAMED` pairs
    are named. A pair without a difference is a dot on the line at 0.

    Source:
        Figure 13 of the curriculum paper: the sorted differences of 75 pieces, with their mean and
        its interval.
    """
    from matplotlib.figure import Figure  # not by pyplot, which keeps figures and may open windows

    n_metrics, n_pairs = len(comparison.metrics), len(comparison.metrics[0].pairs)
    n_rows = math.ceil(n_metrics / _COLUMNS)
    n_columns = math.ceil(n_metrics / n_rows)
    height = _MARGINS + _LINE * n_pairs if n_pairs <= MOST_NAMED else _HEIGHT
    size = (_WIDTH * n_columns, height * n_rows + _MARGINS)
    figure = Figure(figsize=size, layout="constrained")
    for number, found in enumerate(comparison.metrics, 1):
        _draw(figure.add_subplot(n_rows, n_columns, number), found)
    _add_legend(figure, 3 * n_columns)
    room = int(_LETTERS_PER_INCH * size[0])
    sources = (f"A: {_end(comparison.a, room)}", f"B: {_end(comparison.b, room)}")
    figure.suptitle("\n".join(sources), fontsize=9, parse_math=False)
    return figure


def _add_legend(figure: Figure, n_columns: int) -> None:
    """Add a legend of all items that any panel shows."""
    drawn: dict[str, Artist] = {}
    for panel in figure.axes:
        handles, labels = panel.get_legend_handles_labels()
        drawn |= zip(labels, handles, strict=True)
    shown = [label for label in _LEGEND if label in drawn]
    figure.legend(
        handles=[drawn[label] for label in shown],
        labels=shown,
        loc="outside lower center",
        ncols=n_columns,
        fontsize=9,
    )


def _draw(panel: Axes, found: MetricComparison) -> None:
    """Draw the pairs of one metric."""
    panel.use_sticky_edges = False  # keeps a margin at 0 where all bars are on one side
    unsorted = np.array([pair.difference for pair in found.pairs])
    order = np.argsort(unsorted, kind="stable")
    differences, places = unsorted[order], np.arange(len(order))
    height = 0.8 if len(order) <= _MOST_APART else 1.0
    for label, chosen, color in (
        (_IS_ABOVE, differences > 0, _ABOVE),
        (_IS_BELOW, differences < 0, _BELOW),
    ):
        if chosen.any():
            panel.barh(places[chosen], differences[chosen], height, color=color, label=label)
    equal = places[differences == 0]
    if len(equal):
        panel.plot(np.zeros(len(equal)), equal, "o", color=_EQUAL, markersize=4, label=_IS_EQUAL)
    _draw_mean(panel, found)
    _label(panel, found)
    panel.set_ylim(-0.8, len(order) - 0.2)
    if len(order) <= MOST_NAMED:
        names = [_middle_left_out(found.pairs[index].name) for index in order]
        panel.set_yticks(places, names, parse_math=False)
    else:
        panel.set_yticks([])
        panel.set_ylabel(f"{len(order)} pairs, sorted")


def _draw_mean(panel: Axes, found: MetricComparison) -> None:
    interval = found.difference.interval
    if interval is not None:
        # Behind the bars, to keep their colours.
        panel.axvspan(*interval, zorder=0, color=_BAND, linewidth=0, label=_IS_INTERVAL)
    panel.axvline(found.difference.mean, color=_MEAN, linestyle="--", label=_IS_MEAN)


def _label(panel: Axes, found: MetricComparison) -> None:
    """Write title and axis label; draw the line at 0 and a grid."""
    known = DEFINITIONS.get(found.metric)
    label, unit = (found.metric, "") if known is None else (known.label, known.unit)
    count = f"B at or above A in {found.n_a_not_above_b} of {len(found.pairs)}"
    panel.set_title(f"{label}\n{count}", fontsize=10, parse_math=False)
    panel.set_xlabel(f"B \N{MINUS SIGN} A [{unit}]" if unit else "B \N{MINUS SIGN} A")
    panel.axvline(0, color="black", linewidth=0.8)
    panel.tick_params(labelsize=8)
    panel.grid(axis="x", alpha=0.3)
    panel.set_axisbelow(True)


def _end(text: str, room: int) -> str:
    """Shorten a path to its end."""
    return text if len(text) <= room else f"…{text[1 - room :]}"


def _middle_left_out(name: str) -> str:
    """Shorten a name in the middle; the end may have the seed."""
    if len(name) <= _LONGEST_NAME:
        return name
    end = _LONGEST_NAME // 2
    return f"{name[: _LONGEST_NAME - end - 1]}…{name[-end:]}"
