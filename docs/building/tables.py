"""Tables that are made of the package itself, where a page has ``<!-- table: NAME -->``."""

from __future__ import annotations

import dataclasses
import functools
import re
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import griffe

from sb3_piano.envs import PianoEnvConfig
from sb3_piano.envs.terms import SELF_ACTUATED_TERMS, TERMS
from sb3_piano.lab.results import Results
from sb3_piano.lab.results.records import Result
from sb3_piano.lab.results.tables import aggregate_table, origin_table, score_table
from sb3_piano.metrics import DEFINITIONS

RESULTS = Path(__file__).parents[1] / "results"
_MARK = re.compile(r"^<!-- table: (.+?) -->$", re.M)


def on_page_markdown(markdown: str, **named: object) -> str:
    """Put each table in the place of its mark; an unknown one is a ``KeyError``."""
    del named  # page, config and files, which MkDocs hands over
    return _MARK.sub(lambda match: TABLES[match[1]](), markdown)


def options() -> str:
    """Return every option of the environments: its values, its default, and what it is."""
    texts = _package()["envs.config.PianoEnvConfig"].attributes
    kinds = typing.get_type_hints(PianoEnvConfig)
    lines = ["| option | values | default | meaning |", "|---|---|---|---|"]
    for field in dataclasses.fields(PianoEnvConfig):
        docstring = texts[field.name].docstring
        assert docstring is not None, f"the option {field.name} has no docstring"
        meaning = _one_line(docstring.value)
        values = _values(kinds[field.name])
        lines.append(f"| `{field.name}` | {values} | {_default(field)} | {meaning} |")
    return "\n".join(lines)


@functools.cache
def _package() -> griffe.Object | griffe.Alias:
    """Return the package as its files are written, with docstrings that Python does not keep."""
    return griffe.load("sb3_piano")


def _values(kind: Any) -> str:
    """Return in words what a type admits."""
    if typing.get_origin(kind) is Literal:
        return ", ".join(f'`"{value}"`' for value in typing.get_args(kind))
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return " or ".join(_values(part) for part in typing.get_args(kind))
    words = {bool: "`True`, `False`", int: "whole number", float: "number", str: "text"}
    return words.get(typing.get_origin(kind) or kind, "mapping")


def _default(field: dataclasses.Field[Any]) -> str:
    if field.default is not dataclasses.MISSING:
        return f"`{field.default!r}`".replace("'", '"')
    assert field.default_factory is not dataclasses.MISSING, f"{field.name} has no default"
    return f"`{field.default_factory()!r}`"


def reward_terms() -> str:
    """Return every term of the reward, with its default weights."""
    lines = ["| term | weight | weight without hands | meaning |", "|---|---:|---:|---|"]
    for name, term in {**TERMS, **SELF_ACTUATED_TERMS}.items():
        both = (TERMS, SELF_ACTUATED_TERMS)
        usual, without = (f"{of[name].weight:g}" if name in of else "" for of in both)
        assert term.value.__doc__ is not None, f"the term {name} has no docstring"
        meaning = term.value.__doc__.partition("\n")[0]
        lines.append(f"| `{name}` | {usual} | {without} | {meaning} |")
    return "\n".join(lines)


def metrics() -> str:
    """Return every number of an episode, by subject."""
    parts = []
    for section in dict.fromkeys(d.section for d in DEFINITIONS.values()):
        lines = [f"### {section}\n", "| name in `info` | label | meaning |", "|---|---|---|"]
        for each in DEFINITIONS.values():
            if each.section == section:
                unit = f" ({each.unit.strip()})" if each.unit else ""
                lines.append(f"| `{each.name}` | {each.label}{unit} | {_one_line(each.meaning)} |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def _one_line(text: str) -> str:
    """Return a text that fits a cell of a table; double backticks are Markdown, too."""
    return " ".join(text.split()).replace("|", "\\|")


def _results(table: Callable[[Sequence[Result]], str], *names: str) -> str:
    """Return a table of the results of files on the reference physics."""
    found = [r for name in names for r in Results.read(RESULTS / f"{name}.json").results]
    return table([r for r in found if r.physics == "reference"])


TABLES: Mapping[str, Callable[[], str]] = {
    "options": options,
    "reward terms": reward_terms,
    "metrics": metrics,
    "results": lambda: _results(score_table, "results"),
    "aggregates": lambda: _results(aggregate_table, "results"),
    "held-out results": lambda: _results(score_table, "held_out"),
    "held-out aggregates": lambda: _results(aggregate_table, "held_out"),
    "results of the tree": lambda: _results(score_table, "tree"),
    "origin of the results": lambda: _results(origin_table, "results", "held_out", "tree"),
}
"""Maker of each table, by its name in a mark."""
