"""A piece as both hands read it, before anything is planned or simulated."""

from __future__ import annotations

from dataclasses import dataclass

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.music import PianoRoll
from sb3_piano.music.fingering.robot import ARMS_APART, release_early
from sb3_piano.music.presses import presses_of_hand
from sb3_piano.reading.arms import dividing_line, wanted_places
from sb3_piano.reading.key_frames import HOLD_DEPTH, HOVER, KeyFrames, key_frames
from sb3_piano.reading.keyboard import KeyPlaces
from sb3_piano.reading.kinematics import HandKinematics
from sb3_piano.reading.presses import TimedPress, time_presses


@dataclass(frozen=True, eq=False, kw_only=True)
class HandReading:
    """What one hand has to do in a piece of T control steps."""

    presses: tuple[TimedPress, ...]
    """Its presses, shortened where it has to leap, in order of time."""
    frames: KeyFrames
    """Targets of its fingertips in all T + 1 states."""
    place: FloatArray
    """(T + 1,) where across the keys it would be if it were alone, m."""
    busy: BoolArray
    """(T + 1,) whether it plays about then."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Reading:
    """What both hands have to do in a piece of T control steps."""

    roll: PianoRoll
    """The piece, with the fingers that play it; without, where a hand lets go of a note."""
    hands: tuple[HandReading, HandReading]
    """The right and the left hand."""
    line: FloatArray
    """(T + 1,) a first line between the arms, m."""


def read_piece(
    roll: PianoRoll,
    hands: tuple[HandKinematics, HandKinematics],
    keys: KeyPlaces,
    *,
    hover: float = HOVER,
    hold_depth: float = HOLD_DEPTH,
    arms_apart: float = ARMS_APART,
    stretch: float = 0.0,
    hurry: int = 0,
) -> Reading:
    """Return what a piece asks of both hands.

    It takes some milliseconds for each second of music; nothing is optimised or simulated. Heights
    and distances are in m, a depth is a share of a key's travel, ``stretch`` and ``hurry`` are
    those of :func:`time_presses`.
    """
    roll = release_early(roll)
    n_states = len(roll) + 1
    read = []
    for side, hand in enumerate(hands):
        presses = time_presses(presses_of_hand(roll, side), hand.sign, stretch, hurry)
        frames = key_frames(presses, hand.sign, n_states, hand.radius, keys, hover, hold_depth)
        place, busy = wanted_places(frames, hand.sign, hand.middle)
        read.append(HandReading(presses=presses, frames=frames, place=place, busy=busy))
    right, left = read
    line = dividing_line((right.place, left.place), (right.busy, left.busy), arms_apart)
    return Reading(roll=roll, hands=(right, left), line=line)
