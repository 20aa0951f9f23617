"""The piano roll: what should be played, and on top of it what was."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from sb3_piano.metrics import presses_of
from sb3_piano.music import UNKNOWN_FINGER
from sb3_piano.performance import Performance
from sb3_piano.viewing.report.hover import HOVER_TEMPLATE, texts_of_notes, texts_of_presses
from sb3_piano.viewing.report.judgement import DueNotes, Fate, PlayedPresses, Verdict
from sb3_piano.viewing.report.keyboard import key_labels, key_range, keyboard_shapes
from sb3_piano.viewing.report.marks import (
    MISSED_MARK,
    NOT_REACHED_MARK,
    PEDAL_MARK,
    PRESS_MARKS,
    Mark,
    finger_mark,
)
from sb3_piano.viewing.report.theme import INK, SHADE, axis, themed

# Sizes in pixels.
_LEGIBLE_ROW, _LEAST_ROW, _MOST_HEIGHT = 13, 9, 560
_PEDAL_HEIGHT, _GAP, _MARGINS = 44, 14, {"l": 44, "r": 12, "t": 8, "b": 44}

# Heights of bars, in rows of the keyboard: the played one lies within the one that is due.
_DUE_HEIGHT, _PLAYED_HEIGHT = 0.92, 0.46

_FIRST_VIEW = 24.0
"""What is shown of a long piece at first, s."""

_MARGIN = 0.1
"""What can be seen before the beginning and after the end, s."""


def piano_roll_figure(
    performance: Performance, notes: DueNotes, presses: PlayedPresses
) -> go.Figure:
    """Return the piano roll of a performance, with the pedal below.

    Each trace has in ``meta`` the id of the :class:`~sb3_piano.viewing.report.marks.Mark` that it
    shows, so that a legend can switch it on and off.

    Args:
        performance: What was played.
        notes: What :func:`~sb3_piano.viewing.report.judgement.judge` says of the notes due.
        presses: What it says of the presses.
    """
    traces = [
        *_due_traces(notes, presses),
        *_played_traces(notes, presses),
        _missed_trace(notes, presses),
        *_pedal_traces(performance),
    ]
    return go.Figure(traces, _layout(performance, notes, presses))


def _due_traces(notes: DueNotes, presses: PlayedPresses) -> list[go.Bar]:
    texts = texts_of_notes(notes, presses)
    reached = notes.fate != Fate.NOT_REACHED
    groups: list[tuple[Mark, npt.NDArray[np.bool_]]] = []
    for finger in (*range(5), UNKNOWN_FINGER):
        of_finger = notes.finger == finger
        if finger >= 0:
            of_finger |= notes.finger == finger + 5
        groups.append((finger_mark(finger), of_finger & reached))
    groups.append((NOT_REACHED_MARK, ~reached))
    return [
        _bars(mark, notes, np.flatnonzero(chosen), texts, _DUE_HEIGHT)
        for mark, chosen in groups
        if chosen.any()
    ]


def _played_traces(notes: DueNotes, presses: PlayedPresses) -> list[go.Bar]:
    texts = texts_of_presses(notes, presses)
    return [
        _bars(mark, presses, np.flatnonzero(presses.verdict == verdict), texts, _PLAYED_HEIGHT)
        for verdict, mark in PRESS_MARKS.items()
    ]


def _bars(
    mark: Mark,
    what: DueNotes | PlayedPresses,
    chosen: npt.NDArray[np.intp],
    texts: Sequence[Sequence[str]],
    height: float,
) -> go.Bar:
    return go.Bar(
        orientation="h",
        base=what.onset[chosen],
        x=(what.offset - what.onset)[chosen],
        y=what.key[chosen],
        width=height,
        marker=mark.bar,
        customdata=[texts[i] for i in chosen],
        hovertemplate=HOVER_TEMPLATE,
        name=mark.name,
        meta=mark.id,
    )


def _missed_trace(notes: DueNotes, presses: PlayedPresses) -> go.Scatter:
    texts = texts_of_notes(notes, presses)
    missed = np.flatnonzero(notes.fate == Fate.MISSED)
    return go.Scatter(
        mode="markers",
        x=notes.onset[missed],
        y=notes.key[missed],
        marker={"symbol": "x-thin", "size": 8, "line": {"width": 2, "color": INK}},
        customdata=[texts[i] for i in missed],
        hovertemplate=HOVER_TEMPLATE,
        name=MISSED_MARK.name,
        meta=MISSED_MARK.id,
    )


def _pedal_traces(performance: Performance) -> list[go.Bar]:
    """Return two rows: when the pedal should be down, and when it was, rightly or wrongly."""
    due = performance.roll.sustain
    played = performance.sustain
    rightly = played & due[: len(played)]
    rows = (
        (1, due, PEDAL_MARK, PEDAL_MARK.id, "pedal due"),
        (0, rightly, PRESS_MARKS[Verdict.HIT], PEDAL_MARK.id, "pedal down, as it should be"),
        (0, played & ~rightly, PRESS_MARKS[Verdict.WRONG], PEDAL_MARK.id, "pedal down, not due"),
    )
    step = performance.roll.control_timestep
    traces = []
    for row, down, mark, meta, text in rows:
        spans = presses_of(down[:, None])
        traces.append(
            go.Bar(
                orientation="h",
                base=spans.first * step,
                x=(spans.end - spans.first) * step,
                y=np.full(len(spans.first), row),
                width=0.6,
                marker=mark.bar,
                customdata=[
                    [f"{first * step:.2f}", f"{end * step:.2f}"]
                    for first, end in zip(spans.first, spans.end, strict=True)
                ],
                hovertemplate=(
                    f"{text}<br>%{{customdata[0]}} to %{{customdata[1]}} s<extra></extra>"
                ),
                name=text,
                meta=meta,
                yaxis="y2",
            )
        )
    return traces


def _layout(performance: Performance, notes: DueNotes, presses: PlayedPresses) -> go.Layout:
    low, high = key_range(np.concatenate([notes.key, presses.key]))
    rows = high - low + 1
    row = max(_LEAST_ROW, min(2 * _LEGIBLE_ROW, _MOST_HEIGHT // rows))
    inner = rows * row + _GAP + _PEDAL_HEIGHT
    pedal_top = _PEDAL_HEIGHT / inner
    start, end = -_MARGIN, performance.roll.duration + _MARGIN
    return themed(
        height=inner + _MARGINS["t"] + _MARGINS["b"],
        margin=_MARGINS,
        barmode="overlay",
        hovermode="closest",
        dragmode="pan",
        meta={"start": start, "end": end},
        shapes=[*keyboard_shapes(), _pedal_shade(), *_end_line(performance)],
        xaxis=axis(
            range=[start, min(end, _FIRST_VIEW)],
            minallowed=start,
            maxallowed=end,
            fixedrange=False,
            anchor="y2",
            title={"text": "seconds"},
        ),
        yaxis=axis(
            domain=[pedal_top + _GAP / inner, 1],
            range=[low - 0.5, high + 0.5],
            showgrid=False,
            **key_labels(low, high, all_white=row >= _LEGIBLE_ROW),
        ),
        yaxis2=axis(
            domain=[0, pedal_top],
            range=[-0.6, 1.6],
            showgrid=False,
            tickvals=[1, 0],
            ticktext=["pedal due", "pedal"],
        ),
    )


def _pedal_shade() -> dict[str, Any]:
    return {
        "type": "rect",
        "layer": "below",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": "y2 domain",
        "y0": 0,
        "y1": 1,
        "fillcolor": SHADE,
        "line": {"width": 0},
    }


def _end_line(performance: Performance) -> list[dict[str, Any]]:
    """Mark where the episode ended, if that is before the piece does."""
    if len(performance) >= len(performance.roll):
        return []
    end = len(performance) * performance.roll.control_timestep
    return [
        {
            "type": "line",
            "xref": "x",
            "x0": end,
            "x1": end,
            "yref": "paper",
            "y0": 0,
            "y1": 1,
            "line": {"color": INK, "width": 1.5, "dash": "dot"},
            "label": {"text": "the episode ended", "textposition": "end", "font": {"size": 11}},
        }
    ]
