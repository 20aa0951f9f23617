"""The marks in the piano roll: what each looks like, and what it means in words."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from sb3_piano.music import FINGER_NAMES, UNKNOWN_FINGER
from sb3_piano.viewing.report.definitions import TOLERANCE
from sb3_piano.viewing.report.judgement import Verdict
from sb3_piano.viewing.report.theme import INK, PAPER, SOUNDING, finger_color

_FINGERS_PER_HAND = 5


@dataclass(frozen=True, kw_only=True)
class Mark:
    """One kind of mark.

    Both kinds of looks are those of one thing: the legend is HTML, which flows on narrow screens.
    """

    id: str
    """Names the traces that it stands for; letters and hyphens."""
    name: str
    """What it is called, in lower case."""
    meaning: str
    """What it means, in one sentence."""
    bar: dict[str, Any] = field(default_factory=dict)
    """The ``marker`` of a plotly bar."""
    css: str = ""
    """Declarations of the swatch in the legend."""


def _solid(color: str) -> dict[str, Any]:
    return {"bar": {"color": color, "line": {"width": 0}}, "css": f"background:{color}"}


def _patterned(shape: str, background: str) -> dict[str, Any]:
    pattern = {"shape": shape, "bgcolor": PAPER, "fgcolor": INK, "size": 5, "solidity": 0.45}
    return {
        "bar": {"color": INK, "pattern": pattern, "line": {"width": 1, "color": INK}},
        "css": f"background:{background};border:1px solid {INK}",
    }


def _stripes(degrees: int) -> str:
    return f"repeating-linear-gradient({degrees}deg,{INK} 0 1.5px,{PAPER} 1.5px 4px)"


def _outlined(color: str, fill: str) -> dict[str, Any]:
    return {
        "bar": {"color": fill, "line": {"width": 1.5, "color": color}},
        "css": f"background:{fill};border:2px solid {color}",
    }


# Green, black, dots and hatching in two directions differ in lightness or texture, so that they can
# be told apart without seeing colours.
PRESS_MARKS = {
    Verdict.HIT: Mark(
        id="hit",
        name="hit",
        meaning=f"Struck within {TOLERANCE} of its onset.",
        **_solid(SOUNDING),
    ),
    Verdict.EARLY: Mark(
        id="early",
        name="early",
        meaning=f"The right key, struck more than {TOLERANCE} too early and held until it is due.",
        **_patterned("/", _stripes(135)),
    ),
    Verdict.LATE: Mark(
        id="late",
        name="late",
        meaning=f"The right key, struck more than {TOLERANCE} too late.",
        **_patterned("\\", _stripes(45)),
    ),
    Verdict.AGAIN: Mark(
        id="again",
        name="struck again",
        meaning="The right key, but its note was hit by another strike.",
        **_patterned(".", f"radial-gradient({INK} 1px,{PAPER} 1.3px) 0 0/4px 4px"),
    ),
    Verdict.WRONG: Mark(
        id="wrong",
        name="wrong",
        meaning="A key that is not due while it is pressed.",
        **_solid(INK),
    ),
}
"""What was played, by what it was."""

MISSED_MARK = Mark(
    id="missed",
    name="missed",
    meaning=f"Due, but its key was not struck within {TOLERANCE}.",
    css=(
        f"background:linear-gradient(45deg,transparent 44%,{INK} 44% 56%,transparent 56%),"
        f"linear-gradient(-45deg,transparent 44%,{INK} 44% 56%,transparent 56%)"
    ),
)

NOT_REACHED_MARK = Mark(
    id="not-reached",
    name="not reached",
    meaning="Due after the episode had ended.",
    **_outlined("#cfcdc6", "#faf9f6"),
)

PEDAL_MARK = Mark(
    id="pedal",
    name="pedal",
    meaning="When the sustain pedal should be down.",
    **_solid("#cfcdc6"),
)


def finger_mark(finger: int) -> Mark:
    """Return the outline of a note that is due, by its finger label.

    Both hands share colours, and so they share marks.

    Args:
        finger: 0-9, or -1.
    """
    if finger == UNKNOWN_FINGER:
        name, meaning = "any finger", "Due, and the score does not say with which finger."
    else:
        name = FINGER_NAMES[finger % _FINGERS_PER_HAND].removeprefix("right ")
        name = name if name == "thumb" else f"{name} finger"
        meaning = f"Due, for the {name} of either hand."
    outline = _outlined(finger_color(finger), finger_color(finger, 0.16))
    return Mark(id=f"due-{name.replace(' ', '-')}", name=name, meaning=meaning, **outline)
