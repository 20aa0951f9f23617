"""What the metrics are called in tables."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from sb3_piano.exceptions import ConfigError, near_names

_FINGERS = ("thumb", "index finger", "middle finger", "ring finger", "little finger")
_HANDS = {"r": "right", "l": "left"}


class MetricName(NamedTuple):
    """A metric in words."""

    section: str
    """What it is about."""
    text: str
    """What it tells of that."""
    digits: int = 3
    """How many decimals are worth showing."""
    alone: str = ""
    """What it is called where it stands alone, if not by section and text."""


METRIC_NAMES: Mapping[str, MetricName] = MappingProxyType(
    {
        "f1": MetricName("Keys", "F1", alone="F1"),
        "non_silent_f1": MetricName("Keys", "non-silent F1", alone="non-silent F1"),
        "precision": MetricName("Keys", "precision"),
        "recall": MetricName("Keys", "recall"),
        "noop_f1": MetricName("Keys", "F1 of playing nothing"),
        "wrong_presses_per_second": MetricName("Keys", "wrong presses a second", 2),
        "onset_f1": MetricName("Onsets", "F1", alone="onset F1"),
        "onset_precision": MetricName("Onsets", "precision"),
        "onset_recall": MetricName("Onsets", "recall"),
        "onset_error_mean_ms": MetricName("Onsets", "mean error of the hits, ms", 1),
        "onset_error_std_ms": MetricName("Onsets", "deviation of the hits, ms", 1),
        "sustain_f1": MetricName("Pedal", "F1"),
        "sustain_precision": MetricName("Pedal", "precision"),
        "sustain_recall": MetricName("Pedal", "recall"),
        "effective_fingers": MetricName("Fingers", "effective number", 2),
        "effective_fingers_right": MetricName("Fingers", "effective number, right hand", 2),
        "effective_fingers_left": MetricName("Fingers", "effective number, left hand", 2),
        "fingering_agreement": MetricName("Fingers", "agreement with the labels"),
        **{
            f"finger_share_{hand}{number}": MetricName(
                "Fingers", f"share of the {_HANDS[hand]} {finger}", 2
            )
            for hand in _HANDS
            for number, finger in enumerate(_FINGERS, start=1)
        },
        "return": MetricName("Return", "in all", 2, alone="return"),
        "normalized_return": MetricName(
            "Return", "share of the highest possible", alone="normalised return"
        ),
        "return_key_press": MetricName("Return", "from pressing keys", 2),
        "return_fingering": MetricName("Return", "from fingering", 2),
        "return_sustain": MetricName("Return", "from the pedal", 2),
        "return_forearm": MetricName("Return", "from keeping the forearms apart", 2),
        "return_energy": MetricName("Return", "from energy", 2),
        "length": MetricName("Return", "control steps", 0, alone="control steps"),
    }
)
"""All metrics of an evaluation, in the order of its table."""


def check_metric_names(names: list[str]) -> None:
    """Refuse names of metrics that do not exist.

    Raises:
        ConfigError: If there is one.
    """
    for name in names:
        if name not in METRIC_NAMES:
            raise ConfigError(
                f"Unknown metric {name!r}.{near_names(name, METRIC_NAMES)} Expected one of "
                f"{', '.join(METRIC_NAMES)}."
            )


def label(name: str) -> str:
    """Return what a metric is called where it stands alone; one from elsewhere by its name."""
    known = METRIC_NAMES.get(name)
    if known is None:
        return name
    return known.alone or f"{known.section}: {known.text}"


def rounded(name: str, value: float) -> str:
    """Return the value of a metric with its number of decimals."""
    digits = METRIC_NAMES[name].digits if name in METRIC_NAMES else 3
    return f"{round(value, digits) + 0.0:.{digits}f}"  # + 0.0 turns -0.0 into 0.0
