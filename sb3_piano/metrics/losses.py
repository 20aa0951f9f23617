"""Losses: where due frames are lost, and where wrong frames come from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, IntArray
from sb3_piano.metrics.frames import same_frames
from sb3_piano.metrics.presses import Presses, presses_of
from sb3_piano.music.constants import FINGER_NAMES, FINGERS_PER_HAND, KEY_IS_BLACK, UNKNOWN_FINGER

DUE_KINDS = ("sounding", "never", "late", "early", "interrupted")
"""Kind of a due frame."""
WRONG_KINDS = ("own_note", "neighbour", "other")
"""Kind of a wrong frame, by its relation to the score."""

_COLOURS = ("white keys", "black keys")
_FINGERS = (*FINGER_NAMES, "no finger")  # -1 is the last one
_CHORDS = ("1 note", "2 notes", "3 notes", "4 or more notes")
ALL = "all"
"""Group of all frames."""
GROUPS = (ALL, *_FINGERS, *_COLOURS, *_CHORDS)
"""Groups of frames, in the order of a table; each but the first by finger,
colour of the key, or size of the chord."""

Counts = Mapping[str, Mapping[str, int]]
"""Number of frames by group and kind, without empty groups."""


@dataclass(frozen=True, kw_only=True)
class Losses:
    """Frames of a performance by group and kind; a frame is a key in a control step."""

    due: Counts
    """Due frames: by the finger of the score, the key's colour and the size of the
    chord that the note belongs to; kinds are :data:`DUE_KINDS`."""
    wrong: Counts
    """Wrong frames: by the finger on the key, and the key's
    colour; kinds are :data:`WRONG_KINDS`."""

    @classmethod
    def sum_of(cls, several: Iterable[Losses]) -> Losses:
        """Add the losses of several performances."""
        listed = list(several)
        return cls(due=_sum(one.due for one in listed), wrong=_sum(one.wrong for one in listed))


def shares_of(counts: Mapping[str, int]) -> dict[str, float]:
    """Return each kind's share of a non-empty group's frames; the sum is 1."""
    total = sum(counts.values())
    return {kind: count / total for kind, count in counts.items()}


def losses_of(
    target: npt.ArrayLike,
    played: npt.ArrayLike,
    target_finger: npt.ArrayLike,
    press_finger: npt.ArrayLike,
) -> Losses:
    """Classify each due frame and each wrong frame of a performance.

    A note is an unbroken run of control steps in which its key is due (:func:`presses_of`). A frame
    of it is

    - ``sounding`` if its key sounds, else
    - ``never`` if the key sounds in no frame of the note,
    - ``late`` if it is before the first frame of the note that sounds,
    - ``early`` if it is after the last one: the key was let go early,
    - ``interrupted`` if it is between them.

    A frame that sounds and is not due belongs to

    - ``own_note`` if the press that it is part of reaches into a note of its key, i.e. the key was
      struck before its time or held beyond it, else
    - ``neighbour`` if a neighbouring key is due in that step: the next one up or down, or the next
      white one to a white key,
    - ``other`` if none is.

    The size of a chord is the number of notes of the same hand that begin in the same control step;
    those without a finger count as a hand's.

    Args:
        target: (T, 88) bool, keys that are due in each control step.
        played: (T, 88) bool, keys that sound.
        target_finger: (T, 88) int, the finger (0-9) of each key that is due, -1 for none.
        press_finger: (T, 88) int, the finger at each key that sounds, -1 for none.

    Raises:
        ValueError: If the shapes differ or are not two-dimensional.
    """
    target, played = same_frames(target, played)
    label, pressed = np.asarray(target_finger), np.asarray(press_finger)
    if label.shape != target.shape or pressed.shape != target.shape:
        raise ValueError(
            f"Fingers need arrays of the shape of the keys, {target.shape}, got {label.shape} and "
            f"{pressed.shape}."
        )
    notes = presses_of(target)
    step, key, note = _frames_of(notes)
    kind = _due_kinds(target, played, notes)
    due = _count(
        DUE_KINDS,
        kind,
        _finger_groups(label[step, key]),
        _colour_groups(key),
        1 + len(_FINGERS) + len(_COLOURS) + _chord_sizes(notes, label)[note],
    )
    presses = presses_of(played)
    step, key, press = _frames_of(presses)
    wrong = ~target[step, key]
    meets = np.bincount(press, ~wrong, minlength=len(presses.key)) > 0
    kind = np.where(_beside(target)[step, key], 1, 2)
    kind[meets[press]] = 0
    step, key, kind = step[wrong], key[wrong], kind[wrong]
    wrongs = _count(WRONG_KINDS, kind, _finger_groups(pressed[step, key]), _colour_groups(key))
    return Losses(due=due, wrong=wrongs)


def _frames_of(presses: Presses) -> tuple[IntArray, IntArray, IntArray]:
    """Return the step, the key and the press of each frame of presses, press by press."""
    length = presses.end - presses.first
    press = np.repeat(np.arange(len(length)), length)
    step = np.arange(len(press)) - (np.cumsum(length) - length - presses.first)[press]
    return step, presses.key[press], press


def _due_kinds(target: BoolArray, played: BoolArray, notes: Presses) -> IntArray:
    """Return the index in ``DUE_KINDS`` of each frame of the notes."""
    step, key, note = _frames_of(notes)
    sounds = played[step, key]
    first, last = np.full(len(notes.key), len(target)), np.full(len(notes.key), -1)
    np.minimum.at(first, note[sounds], step[sounds])
    np.maximum.at(last, note[sounds], step[sounds])
    conditions = (sounds, (last < 0)[note], step < first[note], step > last[note])
    return np.select(conditions, range(4), default=4)


def _beside(due: BoolArray) -> BoolArray:
    """Return the keys beside a due key, (T, n) bool."""
    beside = np.zeros_like(due)
    beside[:, 1:] |= due[:, :-1]
    beside[:, :-1] |= due[:, 1:]
    white = ~KEY_IS_BLACK[: due.shape[1]]
    beside[:, 2:] |= due[:, :-2] & (white[2:] & white[:-2])
    beside[:, :-2] |= due[:, 2:] & (white[2:] & white[:-2])
    return beside


def _chord_sizes(notes: Presses, label: npt.NDArray[np.integer]) -> IntArray:
    """Return the index in ``_CHORDS`` of each note."""
    finger = label[notes.first, notes.key]
    hand = np.where(finger == UNKNOWN_FINGER, 2, finger // FINGERS_PER_HAND)
    chord = notes.first * 3 + hand
    _, inverse, count = np.unique(chord, return_inverse=True, return_counts=True)
    return np.minimum(count[inverse], len(_CHORDS)) - 1


def _finger_groups(finger: npt.NDArray[np.integer]) -> IntArray:
    return 1 + np.where(finger == UNKNOWN_FINGER, len(FINGER_NAMES), finger).astype(np.intp)


def _colour_groups(key: IntArray) -> IntArray:
    return 1 + len(_FINGERS) + KEY_IS_BLACK[key].astype(np.intp)


def _count(kinds: tuple[str, ...], kind: IntArray, *groups: IntArray) -> Counts:
    """Count frames by kind in every group they belong to."""
    table = np.zeros((len(GROUPS), len(kinds)), dtype=int)
    for group in (np.zeros_like(kind), *groups):
        np.add.at(table, (group, kind), 1)
    rows = zip(GROUPS, table.tolist(), strict=True)
    return {group: dict(zip(kinds, row, strict=True)) for group, row in rows if any(row)}


def _sum(several: Iterable[Counts]) -> Counts:
    total: dict[str, Counter[str]] = {}
    for counts in several:
        for group, kinds in counts.items():
            total.setdefault(group, Counter()).update(kinds)
    return {group: dict(total[group]) for group in GROUPS if group in total}
