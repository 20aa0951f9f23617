"""All music metrics of an episode: their names, meanings and values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics.fingers import effective_fingers, finger_shares, fingering_agreement
from sb3_piano.metrics.frames import count_frames, frame_scores
from sb3_piano.metrics.onsets import (
    ONSET_TOLERANCE,
    Onsets,
    OnsetScores,
    match_onsets,
    timing_error_of,
)
from sb3_piano.metrics.presses import wrong_presses_per_second


@dataclass(frozen=True)
class Definition:
    """A number in words. They are in lower case, to begin a line or to stand in a sentence."""

    name: str
    """Its name in ``info``."""
    section: str
    """Subject; heads a part of a table."""
    label: str
    """Label where it stands alone."""
    meaning: str
    """Meaning, a sentence in one line."""
    short: str
    """Label under its section's heading."""
    unit: str = ""
    """Its unit; empty for a share or a plain number."""
    digits: int = 3
    """Number of decimals to show."""

    def rounded(self, value: float) -> str:
        """Return a value with its number of decimals, without its unit."""
        return f"{round(value, self.digits) + 0.0:.{self.digits}f}"  # + 0.0 turns -0.0 into 0.0


_HANDS = ("right", "left")
_FINGERS = ("thumb", "index finger", "middle finger", "ring finger", "little finger")

# By section and name: the label, the meaning, and the label under the section's heading if it is
# another one.
_WORDS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "Keys, step by step": {
        "f1": ("F1", "Frame F1: mean over control steps; silence that is due counts as 1."),
        "precision": ("precision", "Share of the sounding keys that are due, mean over steps."),
        "recall": ("recall", "Share of the keys due that sound, mean over steps."),
        "non_silent_f1": ("non-silent F1", "F1 over the steps in which the piece sounds."),
        "noop_f1": ("F1 of playing nothing", "The F1 that resting hands have, for comparison."),
        "wrong_presses_per_second": (
            "wrong presses",
            "Presses during which the key is never due, in a second.",
        ),
    },
    "Notes, strike by strike": {
        "onset_f1": ("onset F1", "Harmonic mean of onset precision and onset recall.", "F1"),
        "onset_precision": (
            "onset precision",
            "Share of the strikes that hit a note.",
            "precision",
        ),
        "onset_recall": (
            "onset recall",
            f"Share of the notes hit: key struck within {1000 * ONSET_TOLERANCE:.0f} ms of the "
            "onset, each strike for one.",
            "recall",
        ),
        "onset_error_mean_ms": ("mean timing error", "How late the hits are; early is negative."),
        "onset_error_std_ms": (
            "spread of the timing error",
            "Standard deviation of how late the hits are.",
        ),
    },
    "Pedal": {
        "sustain_f1": ("pedal F1", "As F1, for the sustain pedal.", "F1"),
        "sustain_precision": ("pedal precision", "As precision, for the pedal.", "precision"),
        "sustain_recall": ("pedal recall", "As recall, for the pedal.", "recall"),
    },
    "Fingers": {
        "effective_fingers": (
            "effective fingers",
            "How many of ten fingers would share the pressing as evenly: exp of the shares' "
            "entropy.",
            "effective number",
        ),
        **{
            f"effective_fingers_{hand}": (
                f"effective fingers, {hand}",
                f"How many of the {hand} hand's five would share its pressing as evenly.",
                f"effective number, {hand}",
            )
            for hand in _HANDS
        },
        "fingering_agreement": (
            "fingering agreement",
            "Share of the rightly pressed keys that the labelled finger presses.",
            "agreement with the labels",
        ),
        **{
            f"finger_share_{hand[0]}{number}": (
                f"share of the {hand} {finger}",
                f"Share of the pressing that the {hand} {finger} does, by time.",
            )
            for hand in _HANDS
            for number, finger in enumerate(_FINGERS, start=1)
        },
    },
    "Return": {
        "return": ("return", "Sum of the rewards of the episode.", "in all"),
        "normalized_return": (
            "normalised return",
            "Share of the highest possible return.",
            "share of the highest possible",
        ),
        "return_key_press": (
            "return from pressing keys",
            "Due keys down, and no others.",
            "pressing keys",
        ),
        "return_fingering": ("return from fingering", "Fingers near their keys.", "fingering"),
        "return_sustain": ("return from the pedal", "The pedal as it should be.", "pedal"),
        "return_forearm": (
            "return from keeping the forearms apart",
            "Forearms that keep apart.",
            "forearms",
        ),
        "return_energy": ("return from energy", "The cost of moving.", "energy"),
        "length": ("control steps", "How long the episode was."),
    },
}
_TIMING = ("onset_error_mean_ms", "onset_error_std_ms")
_UNITS = {**dict.fromkeys(_TIMING, "ms"), "wrong_presses_per_second": "/s"}
_DIGITS = {**dict.fromkeys(_TIMING, 1), "length": 0}


def _digits(name: str) -> int:
    two = name.startswith(("effective_fingers", "finger_share_", "return"))
    return _DIGITS.get(name, 2 if two else 3)


DEFINITIONS: Mapping[str, Definition] = MappingProxyType(
    {
        name: Definition(
            name,
            section,
            label,
            meaning,
            short=(*short, label)[0],
            unit=_UNITS.get(name, ""),
            digits=_digits(name),
        )
        for section, words in _WORDS.items()
        for name, (label, meaning, *short) in words.items()
    }
)
"""By name, in the order of a table: ``EPISODE_METRICS``, ``return_<term>`` for each reward term of
the environments, and what every episode has: ``return`` and ``length``."""


def has_value(name: str, metrics: Mapping[str, float]) -> bool:
    """Return whether a number says anything: timing does not where nothing was hit.

    Args:
        name: Its name.
        metrics: All numbers of the episode or episodes, by name.
    """
    return name in metrics and not (name in _TIMING and metrics.get("onset_recall") == 0)


def normalized_return(value: float, highest: float) -> float:
    """Return the share of the highest return that the piece allows: ``value / highest``.

    It is below 0 if the costs outweigh the rewards.

    Args:
        value: The return.
        highest: The highest return that the piece allows, at least 0.

    Returns:
        The share; 1.0 if the highest return is 0, as in a piece without a step.
    """
    return float(value / highest) if highest else 1.0


BoolArray = npt.NDArray[np.bool_]
FingerArray = npt.NDArray[np.int8]

FINGER_SHARES = tuple(f"finger_share_{hand}{finger}" for hand in "rl" for finger in range(1, 6))
"""Names of the ten shares of the pressing, in the order of the fingers 0-9: right thumb
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
"""Names of the music metrics that an environment puts into ``info`` at the end of an episode."""


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
    frames = count_frames(target_keys, played_keys)
    pedal = frame_scores(target_pedal[:, None], played_pedal[:, None])
    pairs = match_onsets(target_onsets, played_onsets)
    onsets = OnsetScores.of_counts(len(pairs), len(played_onsets.key), len(target_onsets.key))
    shares = finger_shares(press_finger)
    values = (
        *frames.scores(),
        *pedal,
        *onsets,
        frames.non_silent_f1(),
        *timing_error_of(target_onsets, played_onsets, pairs),
        wrong_presses_per_second(target_keys, played_keys, control_timestep),
        effective_fingers(shares),
        effective_fingers(shares[: len(_FINGERS)]),
        effective_fingers(shares[len(_FINGERS) :]),
        fingering_agreement(press_finger, target_finger),
        *shares.tolist(),
        frames.noop_f1(),
    )
    return dict(zip(EPISODE_METRICS[:-1], values, strict=True))
