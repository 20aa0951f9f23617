"""The report's tables, tiles and lists, as HTML."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from html import escape

from sb3_piano.metrics import DEFINITIONS, FINGER_SHARES, has_value
from sb3_piano.viewing.report.definitions import definition_of, formatted
from sb3_piano.viewing.report.marks import Mark
from sb3_piano.viewing.report.rewards import NOTHING, PLAYED

_HEADLINES = ("f1", "onset_f1", "normalized_return", "wrong_presses_per_second")
_RATE = "wrong_presses_per_second"

Baseline = Mapping[str, float] | None


def headlines_html(metrics: Mapping[str, float], baseline: Baseline) -> str:
    """Return tiles of the most important numbers, each beside what playing nothing scores."""
    tiles = [_tile(name, metrics, baseline) for name in _HEADLINES if name in metrics]
    return f'<dl class="tiles">{"".join(tiles)}</dl>'


def _tile(name: str, metrics: Mapping[str, float], baseline: Baseline) -> str:
    definition = definition_of(name)
    beside, tick = "", ""
    if baseline is not None and name in baseline:
        beside = f'<dd class="beside">{NOTHING}: {formatted(name, baseline[name])}</dd>'
        tick = f'<b style="left:calc({_percent(baseline[name])}% - 1px)"></b>'
    bar = f'<i style="width:{_percent(metrics[name])}%"></i>{tick}'
    return (
        f'<div class="tile" title="{escape(definition.meaning)}">'
        f"<dt>{escape(definition.label)}</dt>"
        f'<dd class="value">{formatted(name, metrics[name])}</dd>'
        + ("" if name == _RATE else f'<dd class="bar" aria-hidden="true">{bar}</dd>')
        + f"{beside}</div>"
    )


def _percent(share: float) -> str:
    return f"{100 * min(max(share, 0.0), 1.0):.1f}"


def metrics_table(metrics: Mapping[str, float], baseline: Baseline) -> str:
    """Return all numbers that have a definition, with it, beside what playing nothing scores.

    The shares of the ten fingers are left out: they have a figure.
    """
    heads = f'<th class="number">{PLAYED}</th>'
    if baseline is not None:
        heads += f'<th class="number">{NOTHING}</th>'
    names = [name for name in DEFINITIONS if name in metrics and name not in FINGER_SHARES]
    rows = []
    for section, group in itertools.groupby(names, key=lambda name: DEFINITIONS[name].section):
        rows.append(f'<tr class="group"><th colspan="4">{escape(section)}</th></tr>')
        rows += [_row(name, metrics, baseline) for name in group]
    return (
        f'<table class="metrics"><thead><tr><th>metric</th>{heads}<th class="meaning">meaning</th>'
        f"</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    )


def _row(name: str, metrics: Mapping[str, float], baseline: Baseline) -> str:
    definition = definition_of(name)
    columns = [metrics] if baseline is None else [metrics, baseline]
    cells = "".join(f'<td class="number">{_value(name, column)}</td>' for column in columns)
    return (
        f"<tr><td>{escape(definition.label)}</td>{cells}"
        f'<td class="meaning">{escape(definition.meaning)}</td></tr>'
    )


def _value(name: str, metrics: Mapping[str, float]) -> str:
    return formatted(name, metrics[name]) if has_value(name, metrics) else "&ndash;"


def legend_html(group: str, marks: Iterable[tuple[Mark, int]]) -> str:
    """Return buttons that show and hide marks.

    Args:
        group: What the marks have in common.
        marks: Each with how often it is there.
    """
    buttons = "".join(
        f'<button type="button" data-mark="{mark.id}" aria-pressed="true" '
        f'title="{escape(mark.meaning)}">{_swatch(mark)}{escape(mark.name)} {count}</button>'
        for mark, count in marks
    )
    return f'<div class="legend"><span class="group">{escape(group)}</span>{buttons}</div>'


def words_html(marks: Iterable[Mark]) -> str:
    """Return a list that says what each mark means."""
    items = "".join(
        f"<dt>{_swatch(mark)}{escape(mark.name)}</dt><dd>{escape(mark.meaning)}</dd>"
        for mark in marks
    )
    return f'<dl class="words">{items}</dl>'


def facts_html(facts: Iterable[tuple[str, str]], code: Iterable[str] = ()) -> str:
    """Return a list of facts.

    Args:
        facts: Name and text of each.
        code: Names of those whose texts are commands.
    """
    commands = frozenset(code)
    items = "".join(
        f"<dt>{escape(name)}</dt><dd>"
        + (f"<code>{escape(text)}</code>" if name in commands else escape(text))
        + "</dd>"
        for name, text in facts
    )
    return f'<dl class="facts">{items}</dl>'


def _swatch(mark: Mark) -> str:
    return f'<span class="swatch" style="{escape(mark.css)}"></span>'
