"""What each number is called, and what it means in one line: the report's only words for them."""

from __future__ import annotations

from dataclasses import dataclass

from sb3_piano.metrics import ONSET_TOLERANCE

TOLERANCE = f"{1000 * ONSET_TOLERANCE:.0f} ms"
"""How far from its onset a strike still hits a note."""


@dataclass(frozen=True)
class Definition:
    """One number that is reported."""

    name: str
    """Its name in ``info``."""
    label: str
    """What it is called."""
    meaning: str
    """What it means, in one line."""
    unit: str = ""
    """Its unit; empty for a share or a plain number."""
    digits: int = 3
    """Digits after the point."""


_KEYS = (
    Definition("f1", "F1", "Frame F1: mean over control steps; silence that is due counts as 1."),
    Definition("precision", "Precision", "Share of the sounding keys that are due, mean of steps."),
    Definition("recall", "Recall", "Share of the keys due that sound, mean over steps."),
    Definition("non_silent_f1", "Non-silent F1", "F1 over the steps in which the piece sounds."),
    Definition("noop_f1", "No-op F1", "F1 of playing nothing, for comparison."),
    Definition(
        "wrong_presses_per_second",
        "Wrong presses",
        "Presses during which the key is never due, in a second.",
        unit="/s",
    ),
)
_ONSETS = (
    Definition("onset_f1", "Onset F1", "Harmonic mean of onset precision and onset recall."),
    Definition("onset_precision", "Onset precision", "Share of the strikes that hit a note."),
    Definition(
        "onset_recall",
        "Onset recall",
        f"Share of the notes hit: key struck within {TOLERANCE} of the onset, each strike for one.",
    ),
    Definition(
        "onset_error_mean_ms",
        "Timing error, mean",
        "How late the hits are; early is negative. 0 without hits.",
        unit="ms",
        digits=1,
    ),
    Definition(
        "onset_error_std_ms",
        "Timing error, spread",
        "Standard deviation of how late the hits are.",
        unit="ms",
        digits=1,
    ),
)
_PEDAL = (
    Definition("sustain_f1", "Pedal F1", "As F1, for the sustain pedal."),
    Definition("sustain_precision", "Pedal precision", "As precision, for the pedal."),
    Definition("sustain_recall", "Pedal recall", "As recall, for the pedal."),
)
_FINGERS = (
    Definition(
        "effective_fingers",
        "Effective fingers",
        "How many of ten fingers would share the pressing as evenly: exp of the shares' entropy.",
        digits=2,
    ),
    Definition("effective_fingers_right", "Right hand", "The same, of its five.", digits=2),
    Definition("effective_fingers_left", "Left hand", "The same, of its five.", digits=2),
    Definition(
        "fingering_agreement",
        "Fingering agreement",
        "Share of the rightly pressed keys that the labelled finger presses.",
    ),
)
_REWARD = (
    Definition("return", "Return", "Sum of the rewards of the episode.", digits=1),
    Definition("normalized_return", "Normalised return", "Share of the highest possible return."),
    Definition("length", "Length", "Control steps of the episode.", digits=0),
)
_TERMS = (
    Definition("return_key_press", "Pressing keys", "Due keys down, and no others.", digits=2),
    Definition("return_fingering", "Fingering", "Fingers near their keys.", digits=2),
    Definition("return_sustain", "Pedal", "The pedal as it should be.", digits=2),
    Definition("return_forearm", "Forearms", "Forearms that keep apart.", digits=2),
    Definition("return_energy", "Energy", "The cost of moving.", digits=2),
)

GROUPS = (
    ("Keys, control step by control step", _KEYS),
    ("Notes, strike by strike", _ONSETS),
    ("Pedal", _PEDAL),
    ("Fingers", _FINGERS),
    ("Reward", (*_REWARD, *_TERMS)),
)
"""All definitions but those of the finger shares, under their headings."""

_BY_NAME = {definition.name: definition for _, group in GROUPS for definition in group}
_TERM_PREFIX = "return_"


def definition_of(name: str) -> Definition:
    """Return what is known of a number; one that nobody defined is called by its name."""
    words = name.removeprefix(_TERM_PREFIX).replace("_", " ").capitalize()
    return _BY_NAME.get(name, Definition(name, words, ""))


def formatted(name: str, value: float) -> str:
    """Return a number with its unit.

    >>> formatted("f1", 0.25)
    '0.250'
    """
    definition = definition_of(name)
    text = f"{round(value, definition.digits) + 0.0:.{definition.digits}f}"  # no -0.0
    return f"{text}\N{NO-BREAK SPACE}{definition.unit}".rstrip().replace("-", "\N{MINUS SIGN}")
