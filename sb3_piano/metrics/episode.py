"""All music metrics of an episode: their names, meanings and values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from sb3_piano.arrays import BoolArray, FingerArray
from sb3_piano.files import read_table
from sb3_piano.metrics.fingers import effective_fingers, finger_shares, fingering_agreement
from sb3_piano.metrics.frames import frame_scores, non_silent_f1, noop_scores
from sb3_piano.metrics.onsets import (
    Onsets,
    OnsetScores,
    match_onsets,
    timing_error_of,
)
from sb3_piano.metrics.presses import wrong_presses_per_second
from sb3_piano.music.constants import FINGERS_PER_HAND


@dataclass(frozen=True)
class Definition:
    """Definition of a number, an entry of ``definitions.yml``."""

    name: str
    """Key in ``info``."""
    section: str
    """Section of the table."""
    label: str
    meaning: str
    short: str
    """Label under its section's heading."""
    unit: str = ""
    digits: int = 3

    def rounded(self, value: float) -> str:
        """Format a value with its number of decimals, without its unit."""
        return f"{round(value, self.digits) + 0.0:.{self.digits}f}"  # + 0.0 turns -0.0 into 0.0


RETURN_PREFIX = "return_"
"""Beginning of the names in the final ``info`` of the sums of the weighted reward terms."""

DEFINITIONS: Mapping[str, Definition] = MappingProxyType(
    {
        name: Definition(name, section, short=words.pop("short", words["label"]), **words)
        for section, numbers in read_table(Path(__file__).with_name("definitions.yml")).items()
        for name, words in numbers.items()
    }
)
"""By name, in table order: ``EPISODE_METRICS``, ``return_<term>`` for each reward term of
the environments, and what every episode has: ``return`` and ``length``."""


def in_order(metrics: Iterable[str]) -> list[str]:
    """Return names in the order of a table; last the returns of terms that nobody defined."""
    found = list(metrics)
    own = [n for n in found if n.startswith(RETURN_PREFIX) and n not in DEFINITIONS]
    return [*(name for name in DEFINITIONS if name in found), *own]


def definition_of(name: str) -> Definition:
    """Return the definition of a number; one that nobody defined is called by its name."""
    if name in DEFINITIONS:
        return DEFINITIONS[name]
    if name.startswith(RETURN_PREFIX):
        words = name.removeprefix(RETURN_PREFIX).replace("_", " ")
        return Definition(name, "Return", f"return from {words}", "", words, digits=2)
    return Definition(name, "", name, "", name)


def has_value(name: str, metrics: Mapping[str, float]) -> bool:
    """Return whether a metric is defined for an episode, given all its metrics.

    Timing needs a hit; the agreement of fingers a key that sounds when it is due. NaN is none.
    """
    needed, value = _NEEDED.get(name), metrics.get(name, math.nan)
    return not math.isnan(value) and (needed is None or metrics.get(needed) != 0)


_NEEDED = {
    "onset_error_mean_ms": "onset_recall",
    "onset_error_std_ms": "onset_recall",
    "fingering_agreement": "non_silent_f1",
}
"""Metric that must not be 0 for another one to be defined."""


def normalized_return(value: float, highest: float) -> float:
    """Return the share of the highest possible return: ``value / highest``.

    It is below 0 if the costs outweigh the rewards.

    Returns:
        The share. Where the highest return is 0, as of rewards that are all costs: 1.0 for a
        return of 0, else 0.0.
    """
    return float(value / highest) if highest else float(value == 0)


FINGER_SHARES = tuple(f"finger_share_{hand}{finger}" for hand in "rl" for finger in range(1, 6))
"""Names of the ten finger shares, in the order of the fingers 0-9: right thumb
(``finger_share_r1``) to little finger, then left."""

EPISODE_METRICS = (
    "precision",
    "recall",
    "f1",
    "sustain_precision",
    "sustain_recall",
    "sustain_f1",
    "onset_precision",
    "onset_recall",
    "onset_f1",
    "non_silent_f1",
    "onset_error_mean_ms",
    "onset_error_std_ms",
    "wrong_presses_per_second",
    "effective_fingers",
    "effective_fingers_right",
    "effective_fingers_left",
    "fingering_agreement",
    *FINGER_SHARES,
    "noop_f1",
    "normalized_return",
)
"""Names of the music metrics in the final ``info`` of an episode."""


def episode_metrics(
    *,
    target_keys: BoolArray,
    played_keys: BoolArray,
    target_pedal: BoolArray,
    played_pedal: BoolArray,
    target_onsets: Onsets,
    played_onsets: Onsets,
    target_finger: FingerArray,
    press_finger: FingerArray,
    control_timestep: float,
) -> dict[str, float]:
    """Return the ``EPISODE_METRICS`` of an episode by name, all but ``normalized_return``.

    Each is defined by the function it comes from: :func:`~sb3_piano.metrics.frame_scores` for keys
    and pedal, ``onset_scores``, ``non_silent_f1``, ``timing_error``, ``wrong_presses_per_second``,
    ``finger_shares``, ``effective_fingers``, ``fingering_agreement``; ``noop_f1`` is the F1 of
    ``noop_scores``. The normalised return needs the reward, of which the music knows nothing.

    Args:
        target_keys: (T, 88) bool, keys that are due in each control step that was played.
        played_keys: (T, 88) bool, keys that sounded.
        target_pedal: (T,) bool, whether the pedal should be down.
        played_pedal: (T,) bool, whether it was.
        target_onsets: The strikes that are due within these steps.
        played_onsets: The strikes that were played.
        target_finger: (T, 88) int8, the label of each key that is due, -1 where there is none.
        press_finger: (T, 88) int8, the finger at each key that sounded, -1 where it was silent.
        control_timestep: Length of a control step, in s.

    Returns:
        Plain floats, in the order of ``EPISODE_METRICS``.

    Raises:
        ValueError: If shapes do not go together.
    """
    pedal = frame_scores(target_pedal[:, None], played_pedal[:, None])
    pairs = match_onsets(target_onsets, played_onsets)
    onsets = OnsetScores.of_counts(len(pairs), len(played_onsets.key), len(target_onsets.key))
    shares = finger_shares(press_finger)
    values = (
        *frame_scores(target_keys, played_keys),
        *pedal,
        *onsets,
        non_silent_f1(target_keys, played_keys),
        *timing_error_of(target_onsets, played_onsets, pairs),
        wrong_presses_per_second(target_keys, played_keys, control_timestep),
        effective_fingers(shares),
        effective_fingers(shares[:FINGERS_PER_HAND]),
        effective_fingers(shares[FINGERS_PER_HAND:]),
        fingering_agreement(press_finger, target_finger),
        *shares.tolist(),
        noop_scores(target_keys).f1,
    )
    return dict(zip(EPISODE_METRICS[:-1], values, strict=True))
