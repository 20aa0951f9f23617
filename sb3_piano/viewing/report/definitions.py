"""Names of the numbers in the report, and their formats."""

from __future__ import annotations

from dataclasses import replace

from sb3_piano.metrics import DEFINITIONS, ONSET_TOLERANCE, Definition

TOLERANCE = f"{1000 * ONSET_TOLERANCE:.0f} ms"
"""Distance from its onset within which a strike hits a note, as text."""

_TERM_PREFIX = "return_"


def definition_of(name: str) -> Definition:
    """Return what is known of a number, its label as it begins a line.

    Reward terms stand under a heading everywhere, and go by their short names; a number that nobody
    defined is called by its name.
    """
    words = name.removeprefix(_TERM_PREFIX).replace("_", " ")
    known = DEFINITIONS.get(name, Definition(name, "", words, words, ""))
    label = known.short if name.startswith(_TERM_PREFIX) else known.label
    return replace(known, label=label[:1].upper() + label[1:])


def formatted(name: str, value: float) -> str:
    """Return a number with its unit.

    >>> formatted("f1", 0.25)
    '0.250'
    """
    definition = definition_of(name)
    text = f"{definition.rounded(value)}\N{NO-BREAK SPACE}{definition.unit}"
    return text.rstrip().replace("-", "\N{MINUS SIGN}")
