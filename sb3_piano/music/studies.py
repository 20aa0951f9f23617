"""Generated studies: scales, a chord progression and a tune, with fingering.

Source: the pieces of RoboPianist's debug set, under its names and with its notes, times, fingers
and velocity.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping
from functools import partial
from types import MappingProxyType
from typing import TypeAlias

from sb3_piano.exceptions import UnknownPieceError, near_names
from sb3_piano.music.note import Note
from sb3_piano.music.score import Score

Touch: TypeAlias = tuple[int, int]
"""A MIDI pitch and the finger (0-9) that strikes it."""

_MAJOR_OCTAVE = (0, 2, 4, 5, 7, 9, 11, 12)
_UP_AND_DOWN = _MAJOR_OCTAVE + _MAJOR_OCTAVE[-2::-1]
_RIGHT_SCALE_FINGERS = (0, 1, 2, 0, 1, 2, 3, 4, 3, 2, 1, 0, 2, 1, 0)
_LEFT_SCALE_FINGERS = (9, 8, 7, 6, 5, 7, 6, 5, 6, 7, 5, 6, 7, 8, 9)

_TWINKLE_PHRASES: tuple[tuple[Touch, ...], ...] = (
    ((60, 0), (60, 0), (67, 2), (67, 2), (69, 3), (69, 3), (67, 2)),
    ((65, 3), (65, 3), (64, 2), (64, 2), (62, 1), (62, 1), (60, 0)),
)


def study(name: str) -> Score:
    """Return a study by its name; `STUDIES` holds the names.

    Raises:
        UnknownPieceError: If there is no study of this name.
    """
    if name not in STUDIES:
        raise UnknownPieceError(
            f"Unknown study {name!r}.{near_names(name, STUDIES)} "
            f"Expected one of: {', '.join(sorted(STUDIES))}."
        )
    return STUDIES[name]()


def major_scale(
    *,
    right: int | None = None,
    left: int | None = None,
    note_duration: float = 0.5,
    title: str = "",
) -> Score:
    """Play a major scale of one octave up and down again, 15 notes a hand, 4 in a bar.

    Args:
        right: MIDI pitch at which the right hand starts; None if it does not play.
        left: The same for the left hand.
        note_duration: Length of each note, in s.
        title: Title of the score.

    Raises:
        ScoreError: If neither hand plays, or the scale does not fit on the keyboard.
    """
    hands = [
        [(tonic + interval, finger) for interval, finger in zip(_UP_AND_DOWN, fingers, strict=True)]
        for tonic, fingers in ((right, _RIGHT_SCALE_FINGERS), (left, _LEFT_SCALE_FINGERS))
        if tonic is not None
    ]
    groups = [(touches, note_duration) for touches in zip(*hands, strict=True)]
    return in_sequence(groups, title, bars=range(0, len(groups), 4))


def in_sequence(
    groups: Iterable[tuple[Iterable[Touch], float]], title: str, *, bars: Container[int] = ()
) -> Score:
    """Play groups of keys one after the other, each held until the next.

    Args:
        groups: For each group its touches and its length in s.
        title: Title of the score.
        bars: Indices of the groups with which a bar begins.
    """
    notes: list[Note] = []
    lines: list[float] = []
    onset = 0.0
    for index, (touches, duration) in enumerate(groups):
        if index in bars:
            lines.append(onset)
        offset = onset + duration
        notes += [
            Note(onset=onset, offset=offset, pitch=pitch, finger=finger)
            for pitch, finger in touches
        ]
        onset = offset
    return Score(notes=notes, title=title, bars=lines)


def _chord_progression(title: str) -> Score:
    """C, F, G and C major: the root in the left hand, a triad in the right, 1 s each; 4/4."""
    basses: tuple[Touch, ...] = ((48, 5), (41, 8), (43, 7), (48, 5))
    roots = (60, 65, 67, 60)
    return in_sequence(
        (
            ((bass, (root, 0), (root + 4, 2), (root + 7, 4)), 1.0)
            for bass, root in zip(basses, roots, strict=True)
        ),
        title,
        bars=(0,),
    )


def _twinkle(title: str) -> Score:
    """Play two phrases in the right hand: 0.5 s a note, the last of each phrase 1 s; 4/4."""
    durations = (0.5,) * 6 + (1.0,)
    return in_sequence(
        (
            ((touch,), duration)
            for phrase in _TWINKLE_PHRASES
            for touch, duration in zip(phrase, durations, strict=True)
        ),
        title,
        bars=(0, 4, 7, 11),
    )


_BUILDERS: dict[str, Callable[..., Score]] = {
    "CMajorScaleOneHand": partial(major_scale, right=72),
    "CMajorScaleTwoHands": partial(major_scale, right=72, left=48),
    "DMajorScaleOneHand": partial(major_scale, right=74),
    "DMajorScaleTwoHands": partial(major_scale, right=74, left=50),
    "CMajorChordProgressionTwoHands": _chord_progression,
    "TwinkleTwinkleLittleStar": _twinkle,
}

STUDIES: Mapping[str, Callable[[], Score]] = MappingProxyType(
    {name: partial(builder, title=name) for name, builder in _BUILDERS.items()}
)
"""The studies by name; calling one makes its score."""
