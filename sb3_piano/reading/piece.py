"""Reading of a piece by both hands, before planning and simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import KEY_IS_BLACK, MIDDLE
from sb3_piano.music.fingering.leaps import TimedPress, time_presses
from sb3_piano.music.fingering.robot import KEY_SPACING, release_early
from sb3_piano.music.presses import presses_of_hand
from sb3_piano.reading.key_frames import HOLD_DEPTH, HOVER, KeyFrames, KeyPlaces, key_frames
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.simulation.scene import SIDES

# A hand counts as busy within so many states before and after it plays.
_BUSY_STATES = 6

_IDLE_APART = 0.05  # additional distance of an idle arm, m


@dataclass(frozen=True, eq=False, kw_only=True)
class HandReading:
    """Presses and targets of one hand in a piece of T control steps."""

    presses: tuple[TimedPress, ...]
    """Its presses in order of time, shortened at leaps."""
    frames: KeyFrames
    """Targets of its fingertips in all T + 1 states."""
    place: FloatArray
    """(T + 1,) its target place across the keys, regardless of the other hand, m."""
    busy: BoolArray
    """(T + 1,) whether it plays at about that time."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Reading:
    """Presses and targets of both hands in a piece of T control steps."""

    roll: PianoRoll
    """The piece with its fingers; notes released early have no finger after the release."""
    hands: tuple[HandReading, HandReading]
    """The right and the left hand."""
    line: FloatArray
    """(T + 1,) initial line between the arms, m."""


def both_hands(scene: PianoScene) -> tuple[HandKinematics, HandKinematics]:
    """Make the kinematics of the right and the left hand of a scene.

    An absent hand is taken from a scene with both hands. It is read as a hand at rest.
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
    dynamics: bool = False,
    leave_early: int = 0,
) -> Reading:
    """Compute the presses and targets of both hands in a piece.

    It takes a few milliseconds for each second of music; nothing is optimised or simulated. Heights
    and distances are in m, a depth is a share of a key's travel; ``stretch``, ``hurry`` and
    ``leave_early`` are as in :func:`time_presses`. With ``dynamics`` fingers strike from as far as
    velocities ask for.
    """
    robot, loudness_step = hands[0].spec, roll.control_timestep if dynamics else 0.0
    roll, states, read = release_early(roll, robot), len(roll) + 1, []
    for side, hand in enumerate(hands):
        presses = time_presses(
            presses_of_hand(roll, side),
            hand.sign,
            stretch,
            hurry,
            robot,
            leave_early,
            roll.sustain.tolist(),
        )
        frames = key_frames(
            presses, hand.sign, states, hand.radius, keys, hover, hold_depth, loudness_step
        )
        place, busy = wanted_places(frames, hand.sign, hand.middle)
        read.append(HandReading(presses=presses, frames=frames, place=place, busy=busy))
    right, left = read
    apart = robot.forearm.apart if arms_apart is None else arms_apart
    line = dividing_line((right.place, left.place), (right.busy, left.busy), apart)
    return Reading(roll=roll, hands=(right, left), line=line)


def wanted_places(frames: KeyFrames, sign: int, rest: float) -> tuple[FloatArray, BoolArray]:
    """Compute the places of a hand by itself across the keys; without targets it is at ``rest``, m.

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
    """Compute an initial line between the arms, (s,) m, which keeps them ``apart``, m.

    It is in the middle between two busy hands; an idle hand gives way to a busy one. Places, (s,)
    m, and ``busy``, (s,) bool, are those of the right and the left hand.
    """
    right, left = places
    extra = np.where(busy[0] & busy[1], 0.0, _IDLE_APART)
    short = np.maximum(left + apart + extra - right, 0)
    share = np.where(busy[0] == busy[1], 0.5, np.where(busy[0], 0.0, 1.0))
    return np.asarray(((right + share * short) + (left - (1 - share) * short)) / 2)


def bounds_of(line: FloatArray, apart: float) -> tuple[FloatArray, FloatArray]:
    """Compute the bounds beyond which the right and the left arm must stay, (s,) m each."""
    return line + apart / 2, line - apart / 2


def coming_presses(hand: HandReading, roll: PianoRoll, count: int) -> FloatArray:
    """Tabulate each finger's present or next press and those after it, in each of T states.

    Returns:
        (T, count, f, 14): the place of the fingertip when the key is down, m, and the key; how many
        states away the first and the last state are in which it is down; 1, and whether the key is
        black, the hand leaps before and after, and the finger strikes the key again; the times of
        the written note in s from the start, and its velocity. All 0 without such a press.
    """
    onsets = {(step, key): time for step, key, time in roll.strikes()}
    states, timestep = np.arange(len(roll))[:, None], roll.control_timestep
    shown = np.zeros((len(roll), count, hand.frames.target.shape[1], 14))
    for finger in range(shown.shape[2]):
        own = [one for one in hand.presses if one.press.finger == finger]
        table = np.zeros((len(own) + 1, 14))  # the last row is no press
        for row, one in zip(table, own, strict=False):
            # The step before leads to the first state.
            key, start = one.press.key, one.press.first - 1
            row[:3] = hand.frames.target[min(one.first, len(hand.place) - 1), finger]
            row[3:6] = key, one.first, one.last
            row[6:11] = True, KEY_IS_BLACK[key], one.leapt, one.leaps, one.repeated
            row[11:13] = onsets.get((start, key), start * timestep), one.press.last * timestep
            row[13] = one.press.velocity
        ends = np.maximum.accumulate([one.last for one in own])
        number = np.searchsorted(ends, states + 1) + np.arange(count)
        shown[:, :, finger] = table[np.minimum(number, len(own))]
    shown[..., 4:6] -= states[:, None, None] * shown[..., 6:7]
    return shown
