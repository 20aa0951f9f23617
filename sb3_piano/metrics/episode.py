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

_FINGERS_PER_HAND = 5


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
        effective_fingers(shares[:_FINGERS_PER_HAND]),
        effective_fingers(shares[_FINGERS_PER_HAND:]),
        fingering_agreement(press_finger, target_finger),
        *shares.tolist(),
        frames.noop_f1(),
    )
    return dict(zip(EPISODE_METRICS[:-1], values, strict=True))
