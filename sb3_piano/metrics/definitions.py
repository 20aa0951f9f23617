"""Names of the metrics of an episode, and their meanings in one line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from sb3_piano.metrics.onsets import ONSET_TOLERANCE


@dataclass(frozen=True)
class Definition:
    """A number in words. They are in lower case, to begin a line or to stand in a sentence."""

    name: str
    """Its name in ``info``."""
    section: str
    """Subject; heads a part of a table."""
    label: str
    """Label where it stands alone."""
    short: str
    """Label under its section's heading."""
    meaning: str
    """Meaning, a sentence in one line."""
    unit: str = ""
    """Its unit; empty for a share or a plain number."""
    digits: int = 3
    """Number of decimals to show."""

    def rounded(self, value: float) -> str:
        """Return a value with its number of decimals, without its unit."""
        return f"{round(value, self.digits) + 0.0:.{self.digits}f}"  # + 0.0 turns -0.0 into 0.0


_KEYS, _NOTES, _PEDAL = "Keys, step by step", "Notes, strike by strike", "Pedal"
_FINGERS, _RETURN = "Fingers", "Return"
_FINGERS_OF_A_HAND = ("thumb", "index finger", "middle finger", "ring finger", "little finger")

_OF_KEYS = (
    Definition(
        "f1",
        _KEYS,
        "F1",
        "F1",
        "Frame F1: mean over control steps; silence that is due counts as 1.",
    ),
    Definition(
        "precision",
        _KEYS,
        "precision",
        "precision",
        "Share of the sounding keys that are due, mean over steps.",
    ),
    Definition(
        "recall", _KEYS, "recall", "recall", "Share of the keys due that sound, mean over steps."
    ),
    Definition(
        "non_silent_f1",
        _KEYS,
        "non-silent F1",
        "non-silent F1",
        "F1 over the steps in which the piece sounds.",
    ),
    Definition(
        "noop_f1",
        _KEYS,
        "F1 of playing nothing",
        "F1 of playing nothing",
        "The F1 that resting hands have, for comparison.",
    ),
    Definition(
        "wrong_presses_per_second",
        _KEYS,
        "wrong presses",
        "wrong presses",
        "Presses during which the key is never due, in a second.",
        unit="/s",
    ),
)
_OF_NOTES = (
    Definition(
        "onset_f1",
        _NOTES,
        "onset F1",
        "F1",
        "Harmonic mean of onset precision and onset recall.",
    ),
    Definition(
        "onset_precision",
        _NOTES,
        "onset precision",
        "precision",
        "Share of the strikes that hit a note.",
    ),
    Definition(
        "onset_recall",
        _NOTES,
        "onset recall",
        "recall",
        f"Share of the notes hit: key struck within {1000 * ONSET_TOLERANCE:.0f} ms of the onset, "
        "each strike for one.",
    ),
    Definition(
        "onset_error_mean_ms",
        _NOTES,
        "mean timing error",
        "mean timing error",
        "How late the hits are; early is negative.",
        unit="ms",
        digits=1,
    ),
    Definition(
        "onset_error_std_ms",
        _NOTES,
        "spread of the timing error",
        "spread of the timing error",
        "Standard deviation of how late the hits are.",
        unit="ms",
        digits=1,
    ),
)
_OF_PEDAL = (
    Definition("sustain_f1", _PEDAL, "pedal F1", "F1", "As F1, for the sustain pedal."),
    Definition(
        "sustain_precision", _PEDAL, "pedal precision", "precision", "As precision, for the pedal."
    ),
    Definition("sustain_recall", _PEDAL, "pedal recall", "recall", "As recall, for the pedal."),
)
_OF_FINGERS = (
    Definition(
        "effective_fingers",
        _FINGERS,
        "effective fingers",
        "effective number",
        "How many of ten fingers would share the pressing as evenly: exp of the shares' entropy.",
        digits=2,
    ),
    *(
        Definition(
            f"effective_fingers_{hand}",
            _FINGERS,
            f"effective fingers, {hand}",
            f"effective number, {hand}",
            f"How many of the {hand} hand's five would share its pressing as evenly.",
            digits=2,
        )
        for hand in ("right", "left")
    ),
    Definition(
        "fingering_agreement",
        _FINGERS,
        "fingering agreement",
        "agreement with the labels",
        "Share of the rightly pressed keys that the labelled finger presses.",
    ),
    *(
        Definition(
            f"finger_share_{hand[0]}{number}",
            _FINGERS,
            f"share of the {hand} {finger}",
            f"share of the {hand} {finger}",
            f"Share of the pressing that the {hand} {finger} does, by time.",
            digits=2,
        )
        for hand in ("right", "left")
        for number, finger in enumerate(_FINGERS_OF_A_HAND, start=1)
    ),
)
_OF_RETURN = (
    Definition(
        "return", _RETURN, "return", "in all", "Sum of the rewards of the episode.", digits=2
    ),
    Definition(
        "normalized_return",
        _RETURN,
        "normalised return",
        "share of the highest possible",
        "Share of the highest possible return.",
    ),
    *(
        Definition(f"return_{term}", _RETURN, f"return from {words}", short, meaning, digits=2)
        for term, words, short, meaning in (
            ("key_press", "pressing keys", "pressing keys", "Due keys down, and no others."),
            ("fingering", "fingering", "fingering", "Fingers near their keys."),
            ("sustain", "the pedal", "pedal", "The pedal as it should be."),
            ("forearm", "keeping the forearms apart", "forearms", "Forearms that keep apart."),
            ("energy", "energy", "energy", "The cost of moving."),
        )
    ),
    Definition(
        "length", _RETURN, "control steps", "control steps", "How long the episode was.", digits=0
    ),
)

DEFINITIONS: Mapping[str, Definition] = MappingProxyType(
    {
        definition.name: definition
        for definition in (*_OF_KEYS, *_OF_NOTES, *_OF_PEDAL, *_OF_FINGERS, *_OF_RETURN)
    }
)
"""By name, in the order of a table: ``EPISODE_METRICS``, ``return_<term>`` for each reward term of
the environments, and what every episode has: ``return`` and ``length``."""

_TIMING = ("onset_error_mean_ms", "onset_error_std_ms")


def has_value(name: str, metrics: Mapping[str, float]) -> bool:
    """Tell whether a number says anything: timing does not where nothing was hit.

    Args:
        name: Its name.
        metrics: All numbers of the episode or episodes, by name.
    """
    return name in metrics and not (name in _TIMING and metrics.get("onset_recall") == 0)
