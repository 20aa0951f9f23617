"""A piece as both hands read it, before anything is planned or simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import MIDDLE
from sb3_piano.music.fingering.robot import KEY_SPACING, release_early
from sb3_piano.music.presses import presses_of_hand
from sb3_piano.reading.key_frames import HOLD_DEPTH, HOVER, KeyFrames, key_frames
from sb3_piano.reading.keyboard import KeyPlaces
from sb3_piano.reading.presses import TimedPress, time_presses
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.simulation.scene import SIDES

# A hand counts as busy so many states before and after it plays.
_BUSY_STATES = 6

_IDLE_APART = 0.05  # additional distance of an arm that plays nothing, m


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


def both_hands(scene: PianoScene) -> tuple[HandKinematics, HandKinematics]:
    """Return the right and the left hand of a scene.

    A hand that is not there is that of a scene with both: it is read as one that rests.
    """
    scenes = [
        scene if name in scene.sides else compile_scene(hand=scene.hand.source) for name in SIDES
    ]
    return HandKinematics(scenes[0], 0), HandKinematics(scenes[1], 1)


def read_piece(
    roll: PianoRoll,
    hands: tuple[HandKinematics, HandKinematics],
    keys: KeyPlaces,
    *,
    hover: float = HOVER,
    hold_depth: float = HOLD_DEPTH,
    arms_apart: float | None = None,
    stretch: float = 0.0,
    hurry: int = 0,
) -> Reading:
    """Return what a piece asks of both hands.

    It takes some milliseconds for each second of music; nothing is optimised or simulated. Heights
    and distances are in m, a depth is a share of a key's travel, ``stretch`` and ``hurry`` are
    those of :func:`time_presses`.
    """
    robot = hands[0].spec
    apart = robot.forearm.apart if arms_apart is None else arms_apart
    roll = release_early(roll, robot)
    n_states = len(roll) + 1
    read = []
    for side, hand in enumerate(hands):
        presses = time_presses(presses_of_hand(roll, side), hand.sign, stretch, hurry, robot)
        frames = key_frames(presses, hand.sign, n_states, hand.radius, keys, hover, hold_depth)
        place, busy = wanted_places(frames, hand.sign, hand.middle)
        read.append(HandReading(presses=presses, frames=frames, place=place, busy=busy))
    right, left = read
    line = dividing_line((right.place, left.place), (right.busy, left.busy), apart)
    return Reading(roll=roll, hands=(right, left), line=line)


def wanted_places(frames: KeyFrames, sign: int, rest: float) -> tuple[FloatArray, BoolArray]:
    """Return where across the keys a hand would be if it were alone; it rests at ``rest``, m.

    Returns:
        (s,) places of the middle finger, m; (s,) whether the hand is busy.
    """
    weight = frames.weight[..., 1]  # (s, f)
    asked: BoolArray = np.asarray(weight.any(axis=1))
    if not asked.any():
        return np.full(len(asked), rest), asked
    fingers = np.arange(frames.target.shape[1]) - MIDDLE
    place = frames.target[..., 1] - sign * KEY_SPACING * fingers
    known = np.flatnonzero(asked)
    mean = (weight * place).sum(axis=1)[known] / weight.sum(axis=1)[known]
    window = np.ones(2 * _BUSY_STATES + 1)
    busy = np.convolve(asked, window)[_BUSY_STATES:-_BUSY_STATES] > 0
    return np.interp(np.arange(len(asked)), known, mean), busy


def dividing_line(
    places: Sequence[FloatArray], busy: Sequence[BoolArray], apart: float
) -> FloatArray:
    """Return a first line between the arms, (s,) m.

    Where both are busy it lies in the middle; a hand that plays makes one that rests give way.

    Args:
        places: Where the right and the left hand want to be, (s,) m each.
        busy: Whether they play, (s,) bool each.
        apart: Least distance of the arms, m.
    """
    right, left = places
    extra = np.where(busy[0] & busy[1], 0.0, _IDLE_APART)
    short = np.maximum(left + apart + extra - right, 0)
    share = np.where(busy[0] == busy[1], 0.5, np.where(busy[0], 0.0, 1.0))
    return np.asarray(((right + share * short) + (left - (1 - share) * short)) / 2)


def bounds_of(line: FloatArray, apart: float) -> tuple[FloatArray, FloatArray]:
    """Return beyond which places the right and the left arm must be, (s,) m each."""
    return line + apart / 2, line - apart / 2
