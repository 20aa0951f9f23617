"""The debug set: two scales, a chord progression and a tune, with fingering.

Source: the pieces of RoboPianist's debug set, with its names, notes, times, fingers and velocity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.music.studies.building import MAJOR_SCALE, in_sequence

_UP_AND_DOWN = (*MAJOR_SCALE, 12, *MAJOR_SCALE[::-1])
_RIGHT_SCALE_FINGERS = (0, 1, 2, 0, 1, 2, 3, 4, 3, 2, 1, 0, 2, 1, 0)
_LEFT_SCALE_FINGERS = (9, 8, 7, 6, 5, 7, 6, 5, 6, 7, 5, 6, 7, 8, 9)

_CHORDS = [
    ((bass, (root, 0), (root + 4, 2), (root + 7, 4)), 1.0)
    for bass, root in (((48, 5), 60), ((41, 8), 65), ((43, 7), 67), ((48, 5), 60))
]
"""C, F, G and C major: the root in the left hand, a triad in the right, 1 s each; 4/4."""

_TWINKLE = [
    ((press,), duration)
    for phrase in (
        ((60, 0), (60, 0), (67, 2), (67, 2), (69, 3), (69, 3), (67, 2)),
        ((65, 3), (65, 3), (64, 2), (64, 2), (62, 1), (62, 1), (60, 0)),
    )
    for press, duration in zip(phrase, (0.5,) * 6 + (1.0,), strict=True)
]
"""Two phrases in the right hand: 0.5 s a note, the last of each phrase 1 s; 4/4."""


def major_scale(
    *,
    right: int | None = None,
    left: int | None = None,
    note_duration: float = 0.5,
    title: str = "",
) -> Score:
    """Make a major scale of one octave up and down, 15 notes a hand, 4 in a bar.

    Args:
        right: First MIDI pitch of the right hand; None if it does not play.
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
    groups = [(presses, note_duration) for presses in zip(*hands, strict=True)]
    return in_sequence(groups, title, bars=range(0, len(groups), 4))


_BUILDERS: dict[str, tuple[str, Callable[..., Score]]] = {
    "CMajorScaleOneHand": ("C major scale, right hand", partial(major_scale, right=72)),
    "CMajorScaleTwoHands": ("C major scale", partial(major_scale, right=72, left=48)),
    "DMajorScaleOneHand": ("D major scale, right hand", partial(major_scale, right=74)),
    "DMajorScaleTwoHands": ("D major scale", partial(major_scale, right=74, left=50)),
    "CMajorChordProgressionTwoHands": (
        "Four chords",
        partial(in_sequence, _CHORDS, bars=(0,)),
    ),
    "TwinkleTwinkleLittleStar": (
        "Twinkle Twinkle Little Star, right hand",
        partial(in_sequence, _TWINKLE, bars=(0, 4, 7, 11)),
    ),
}

DEBUG: Mapping[str, Piece] = MappingProxyType(
    {
        f"debug-{name}": Piece(
            name=f"debug-{name}",
            title=title,
            collection="debug",
            source="RoboPianist's debug set",
            fingering="RoboPianist's",
            build=partial(builder, title=name),
        )
        for name, (title, builder) in _BUILDERS.items()
    }
)
"""The pieces of the debug set by name."""
