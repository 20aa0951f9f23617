"""Render HTML pages from templates; each is one file and needs no network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from types import MappingProxyType
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from sb3_piano.exceptions import MissingPackageError
from sb3_piano.metrics import episode
from sb3_piano.metrics.episode import RETURN_PREFIX, Definition, has_value
from sb3_piano.metrics.onsets import ONSET_TOLERANCE
from sb3_piano.viewing.moment import FINGER_COLORS, PRESSED_COLOR, UNLABELLED_COLOR

TOLERANCE = f"{1000 * ONSET_TOLERANCE:.0f} ms"
"""Largest distance of a strike from the onset of a note that it hits, as text."""


def definition_of(name: str, labels: Mapping[str, str] = MappingProxyType({})) -> Definition:
    """Return the definition of a number, with its label capitalised.

    Reward terms always have a heading, so they use their short names, or their own ``labels``.
    """
    known = episode.definition_of(name)
    term = name.removeprefix(RETURN_PREFIX)
    label = known.label.replace("_", " ") if term == name else labels.get(term) or known.short
    return replace(known, label=label[:1].upper() + label[1:])


def formatted(name: str, value: float) -> str:
    """Format a number with its unit.

    >>> formatted("f1", 0.25)
    '0.250'
    """
    definition = definition_of(name)
    text = f"{definition.rounded(value)}\N{NO-BREAK SPACE}{definition.unit}"
    return text.rstrip().replace("-", "\N{MINUS SIGN}")


FINGERS = ("thumb", "index-finger", "middle-finger", "ring-finger", "little-finger")
"""Names of the five fingers in colours, classes and ids of the page."""


def css_color(rgba: Sequence[float]) -> str:
    """Convert a colour to CSS, without its opacity.

    >>> css_color((1.0, 0.5, 0.0, 1.0))
    'rgb(255,128,0)'
    """
    red, green, blue = (round(255 * part) for part in rgba[:3])
    return f"rgb({red},{green},{blue})"


PALETTE = {
    "ink": "#22252b",
    "muted": "#666b73",
    "rule": "#e4e2dc",
    "paper": "#ffffff",
    "shade": "#f3f1ec",
    "ground": "#faf9f6",
    "absent": "#cfcdc6",
    "resting": "#c9c6be",
    "sounding": css_color(PRESSED_COLOR),
    "any-finger": css_color(UNLABELLED_COLOR),
    **{name: css_color(FINGER_COLORS[finger]) for finger, name in enumerate(FINGERS)},
}
"""Every colour of a page by name; style sheet and script use them as CSS variables."""


def render(template: str, **context: Any) -> str:
    """Render a template of ``templates/`` to a page; its context is escaped.

    Figures may contain arrays and Plotly objects.
    """
    return _environment().get_template(template).render(context)


def plural(number: int, one: str, many: str = "") -> str:
    """Format a count with its noun.

    >>> plural(1, "trial"), plural(2, "trial"), plural(0, "press", "presses")
    ('1 trial', '2 trials', '0 presses')
    """
    return f"{number} {one if number == 1 else many or one + 's'}"


@cache
def _environment() -> Environment:
    try:
        from plotly.offline import get_plotlyjs  # slow to import, and only pages need it
        from plotly.utils import PlotlyJSONEncoder
    except ImportError as error:
        raise MissingPackageError(
            "A page needs plotly, which is not installed: pip install plotly"
        ) from error

    loader = PackageLoader("sb3_piano.viewing.report")
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"cls": PlotlyJSONEncoder}
    environment.filters.update(plural=plural)
    environment.globals.update(
        static=lambda name: Markup(loader.get_source(environment, name)[0]),
        plotly=lambda: Markup(get_plotlyjs()),
        palette=PALETTE,
        tolerance=TOLERANCE,
        definition_of=definition_of,
        formatted=formatted,
        has_value=has_value,
    )
    return environment
