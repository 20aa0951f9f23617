"""The report of an episode: what was played, and how the player was trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sb3_piano.metrics import DEFINITIONS, FINGER_SHARES
from sb3_piano.performance import Performance
from sb3_piano.viewing.report.figures import (
    NOTHING,
    PLAYED,
    Curve,
    finger_usage,
    reward_terms,
    training_panels,
)
from sb3_piano.viewing.report.judgement import Fate, Verdict, judge
from sb3_piano.viewing.report.page import render
from sb3_piano.viewing.report.piano_roll import PEDAL_MARK, legends, piano_roll


@dataclass(frozen=True, kw_only=True)
class Report:
    """Content of a report. All texts may hold anything, they are escaped."""

    performance: Performance
    """The performance; its title is the report's."""
    metrics: Mapping[str, float]
    """The numbers of that episode by their names in ``info``, ``return`` and ``length`` too."""
    baseline: Mapping[str, float] | None = None
    """The same of an episode in which the hands rest."""
    curves: Mapping[str, Curve] = field(default_factory=dict)
    """The training's log by name; empty if there is none."""
    subtitle: str = ""
    """Who played, in one line."""
    facts: Sequence[tuple[str, str]] = ()
    """How this was made: name and text of each fact."""
    commands: Sequence[tuple[str, str]] = ()
    """How to do it again: what for, and the command line."""


def report_html(report: Report) -> str:
    """Return the page: it can be sent, kept and opened without a network."""
    performance, metrics, baseline = report.performance, report.metrics, report.baseline
    notes, presses = judge(performance)
    columns = {PLAYED: metrics} if baseline is None else {PLAYED: metrics, NOTHING: baseline}
    return render(
        "run.html",
        title=performance.title or "untitled",
        report=report,
        strikes=len(performance.roll.onset_time),
        hit=int((notes.fate == Fate.HIT).sum()),
        off=int(((presses.verdict == Verdict.EARLY) | (presses.verdict == Verdict.LATE)).sum()),
        wrong=int((presses.verdict == Verdict.WRONG).sum()),
        unreached=int((notes.fate == Fate.NOT_REACHED).sum()),
        columns=columns,
        nothing=NOTHING,
        # The shares of the ten fingers have a figure.
        names=[name for name in DEFINITIONS if name in metrics and name not in FINGER_SHARES],
        legends=legends(notes, presses),
        pedal_mark=PEDAL_MARK,
        piano_roll=piano_roll(performance, notes, presses),
        finger_usage=finger_usage(performance, metrics),
        reward_terms=reward_terms(metrics, baseline),
        panels=training_panels(report.curves, baseline),
    )
