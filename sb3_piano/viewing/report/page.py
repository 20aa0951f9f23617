"""The report: one HTML file that needs nothing else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

from sb3_piano.performance import Performance
from sb3_piano.viewing.report.curves import Curve, training_figures
from sb3_piano.viewing.report.definitions import TOLERANCE, formatted
from sb3_piano.viewing.report.document import document_html
from sb3_piano.viewing.report.fingers import finger_usage_figure
from sb3_piano.viewing.report.judgement import DueNotes, Fate, PlayedPresses, Verdict, judge
from sb3_piano.viewing.report.marks import (
    MISSED_MARK,
    NOT_REACHED_MARK,
    PEDAL_MARK,
    PRESS_MARKS,
    Mark,
    finger_mark,
)
from sb3_piano.viewing.report.piano_roll import piano_roll_figure
from sb3_piano.viewing.report.rewards import reward_terms_figure
from sb3_piano.viewing.report.script import ROLL_ID, SCRIPT
from sb3_piano.viewing.report.tables import (
    facts_html,
    headlines_html,
    legend_html,
    metrics_table,
    words_html,
)
from sb3_piano.viewing.report.theme import figure_html

_VIEWS = (
    ("earlier", "← earlier"),
    ("later", "later →"),
    ("closer", "closer"),
    ("wider", "wider"),
    ("all", "whole piece"),
)


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a report tells. All texts may hold anything, they are escaped."""

    performance: Performance
    """What was played; its title is the report's."""
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
    """Return the page.

    It holds the plotting library, its figures, style and script, and asks for nothing else: it can
    be sent, kept and opened without a network.
    """
    title = escape(report.performance.title or "untitled")
    notes, presses = judge(report.performance)
    parts = [
        f'<p class="eyebrow">{escape(report.subtitle)}</p><h1>{title}</h1>',
        f"<p>{_summary(notes, presses, len(report.performance.roll.onset_time))}</p>",
        headlines_html(report.metrics, report.baseline),
        _roll_section(report.performance, notes, presses),
        f'<div class="pair">{_finger_section(report)}{_reward_section(report)}</div>',
        _training_section(report),
        f"<section><h2>All numbers</h2>{metrics_table(report.metrics, report.baseline)}</section>",
        _facts_section(report),
    ]
    return document_html(report.performance.title or "untitled", parts, SCRIPT)


def _summary(notes: DueNotes, presses: PlayedPresses, strikes: int) -> str:
    hit = int((notes.fate == Fate.HIT).sum())
    wrong = int((presses.verdict == Verdict.WRONG).sum())
    off = int(((presses.verdict == Verdict.EARLY) | (presses.verdict == Verdict.LATE)).sum())
    unreached = int((notes.fate == Fate.NOT_REACHED).sum())
    text = (
        f"{hit} of {strikes} notes hit within {TOLERANCE}; {_count(off, 'strike')} too early or "
        f"too late; {_count(wrong, 'wrong press', 'wrong presses')}."
    )
    return text + (f" The episode ended before {unreached} of the notes." if unreached else "")


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _roll_section(performance: Performance, notes: DueNotes, presses: PlayedPresses) -> str:
    figure = piano_roll_figure(performance, notes, presses)
    verdicts = Counter(presses.verdict.tolist())
    played = [(mark, verdicts[int(verdict)]) for verdict, mark in PRESS_MARKS.items()]
    due = _due_marks(notes)
    buttons = "".join(
        f'<button type="button" data-view="{view}">{text}</button>' for view, text in _VIEWS
    )
    words = words_html([*(mark for mark, _ in (*played, *due)), PEDAL_MARK])
    return (
        "<section><h2>Piano roll</h2>"
        '<p class="note">Outlined: what is due, in the colour of its finger. Filled: what was '
        "played. Point at a bar for its pitch, finger and timing; drag to move along.</p>"
        f"{legend_html('played', played)}{legend_html('due', due)}"
        f"{figure_html(figure, ROLL_ID)}"
        f'<div class="views" role="group" aria-label="View">{buttons}</div>'
        f"<details open><summary>What the marks mean</summary>{words}</details></section>"
    )


def _due_marks(notes: DueNotes) -> list[tuple[Mark, int]]:
    """Return the marks of the notes that are due, those that are not there left out."""
    reached = notes.fate != Fate.NOT_REACHED
    counts = Counter(finger_mark(int(finger)).id for finger in notes.finger[reached])
    marks = {mark.id: mark for mark in map(finger_mark, (*range(5), -1))}
    found = [(mark, counts[name]) for name, mark in marks.items() if counts[name]]
    unreached = int((~reached).sum())
    return [
        (MISSED_MARK, int((notes.fate == Fate.MISSED).sum())),
        *found,
        *([(NOT_REACHED_MARK, unreached)] if unreached else []),
    ]


def _finger_section(report: Report) -> str:
    metrics = report.metrics
    numbers = [formatted(f"effective_fingers{hand}", metrics[f"effective_fingers{hand}"])
               for hand in ("", "_right", "_left")]  # fmt: skip
    return (
        "<section><h2>Fingers</h2>"
        '<p class="note">Filled: each finger&rsquo;s share of the pressing, by time. Outlined: '
        f"what the score&rsquo;s fingering asks for. Effectively {numbers[0]} of ten fingers play: "
        f"{numbers[1]} of the right hand, {numbers[2]} of the left.</p>"
        f"{figure_html(finger_usage_figure(report.performance, metrics), 'finger-usage')}</section>"
    )


def _reward_section(report: Report) -> str:
    figure = reward_terms_figure(report.metrics, report.baseline)
    if figure is None:
        return ""
    return (
        '<section><h2>Reward</h2><p class="note">What each weighted term of the reward summed up '
        f"to in the episode.</p>{figure_html(figure, 'reward-terms')}</section>"
    )


def _training_section(report: Report) -> str:
    figures = training_figures(report.curves, report.baseline)
    if not figures:
        return (
            '<section><h2>Training</h2><p class="note">There is no log of the training that could '
            "be drawn.</p></section>"
        )
    panels = "".join(
        f"<div><h3>{escape(name)}</h3>{figure_html(figure, f'training-{number}')}</div>"
        for number, (name, figure) in enumerate(figures.items(), start=1)
    )
    return f'<section><h2>Training</h2><div class="grid">{panels}</div></section>'


def _facts_section(report: Report) -> str:
    names = [name for name, _ in report.commands]
    facts = facts_html([*report.facts, *report.commands], code=names)
    return f"<section><h2>How this was made</h2>{facts}</section>"
