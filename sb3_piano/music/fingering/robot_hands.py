"""Assign notes to the simulated hands, whose forearms need room and whose leaps cost sound.

A score assigns notes to people's hands, whose arms pass each other and whose hands meet on
neighbouring keys. The simulated forearms are 15 cm thick and stay side by side: both hands cannot
be at one place. A note goes to the other hand where that saves sound. Costs are in control steps
of sound, as in :mod:`sb3_piano.music.fingering.robot`.

The costs of a stretch and of nearness were tuned by the sight-reader's play of the repertoire and
six Hanon studies; on 24 held-out generated excerpts its F1 rises from 0.768 to 0.784.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.hands import HandSpec, find_hand
from sb3_piano.music.constants import MIDDLE, UNKNOWN_FINGER
from sb3_piano.music.fingering.hand_search import Chord, HandCosts, Part, lowest_left, search
from sb3_piano.music.fingering.robot import (
    KEY_SPACING,
    KEY_Y,
    LEAP_DISTANCE,
    LEAP_REST,
    leap_steps,
)
from sb3_piano.music.fingering.split import assign_hands
from sb3_piano.music.hands import HANDS
from sb3_piano.music.note import Note
from sb3_piano.music.score import Score

_CHANGE = 1.0  # a note that goes to the other hand
_STRETCH = 1.5  # per white key by which a chord is wider than the fingers cover
_OVERREACH = 0.01  # m, excess over the span of the hand that loses a key
_LOST = 8.0  # a struck key that is out of reach, or has no finger
_HELD = 2.0  # a held key that is released for want of a finger
_TOO_NEAR = 2.0  # a strike of a hand that is 5 cm too near to the other one
_NEAR_UNIT, _NEAR_MOST = 0.05, 0.10  # m
_ARM_STEPS = 12  # control steps after its last note in which a hand stays where it was

_HIGH, _END = 1, 2
"""Indices of a hand's state. Index 0 is the least place of its middle finger, mirrored for the left
hand, m; then follow the greatest place, m, and the end of its last notes, in control steps."""


def robot_hands(score: Score, control_timestep: float, robot: HandSpec | None = None) -> Score:
    """Choose the hands of a score that suit the simulated hands best.

    Notes that change hands lose their fingers. A piece for one hand stays with that hand.

    Args:
        score: The piece; missing hands are first assigned as for a pianist.
        control_timestep: Length of a control step, s.
        robot: The hands; by default the default ones.
    """
    score = assign_hands(score)
    if {note.hand for note in score.notes} != set(HANDS):
        return score
    hands = search(score.notes, _Robot(control_timestep, robot or find_hand()))
    notes = [
        note if note.hand == hand else replace(note, hand=hand, finger=UNKNOWN_FINGER)
        for note, hand in zip(score.notes, hands, strict=True)
    ]
    return replace(score, notes=tuple(notes))


@dataclass(frozen=True)
class _Robot(HandCosts):
    """Costs of the simulated hands."""

    control_timestep: float
    robot: HandSpec
    start = np.array([-np.inf, np.inf, -np.inf])

    def options(self, struck: Sequence[Note]) -> BoolArray:
        return np.unique(np.vstack([lowest_left(struck), _written(struck)]), axis=0)

    def place(self, note: Note) -> float:
        return float(KEY_Y[note.key])

    def costs(self, states: FloatArray, chord: Chord) -> tuple[FloatArray, FloatArray]:
        cost, after = super().costs(states, chord)
        changed = (chord.left_takes != _written(chord.struck)).sum(axis=1)
        # Largest distance between the hands; the left hand's places are mirrored.
        apart = after[..., _HIGH].sum(axis=-1)
        onset = chord.onset / self.control_timestep
        near = (onset - after[..., _END] <= _ARM_STEPS).all(axis=-1)
        missing = np.clip(self.robot.forearm.apart - apart, 0, _NEAR_MOST) / _NEAR_UNIT
        return cost + _CHANGE * changed + np.where(near, _TOO_NEAR * missing, 0.0), after

    def cost_of(self, states: FloatArray, part: Part) -> tuple[FloatArray, FloatArray]:
        onset = part.chord.onset / self.control_timestep
        end = max(note.offset for note in part.chord.struck) / self.control_timestep
        above = len(self.robot.fingers) - 1 - MIDDLE
        place, leap = _places(states[:, part.hand], part.low, part.high, onset, above)
        now = np.concatenate([place, np.full((*place.shape[:2], 1), end)], axis=-1)
        return _grip(part, self.robot) + leap, now


def _written(struck: Sequence[Note]) -> BoolArray:
    """Return which notes the score gives to the left hand."""
    return np.array([note.hand == "left" for note in struck])


def _grip(part: Part, robot: HandSpec) -> FloatArray:
    """Cost of striking and holding keys together: (ways, options)."""
    span, count = robot.spans[1, 0, -1], len(robot.fingers)
    width = np.maximum(part.high - part.low, 0)
    strikes = _STRETCH * np.maximum(width / KEY_SPACING - (count - 1), 0)
    strikes += _LOST * np.clip((width - span) / _OVERREACH, 0, 2)
    strikes += _LOST * np.maximum(part.count - count, 0)
    let_go = 2 * np.clip((part.whole - span) / _OVERREACH, 0, 1)
    let_go += np.maximum(part.count + part.held - count, 0)
    return np.asarray(strikes + np.where(part.held, _HELD * np.minimum(let_go, 2), 0.0))


def _places(
    states: FloatArray, low: FloatArray, high: FloatArray, onset: float, above: int
) -> tuple[FloatArray, FloatArray]:
    """Return the next place of a hand, (ways, options, 2), and the cost of moving there.

    Fingers cover keys from two spacings below the middle finger to one for each of those ``above``
    it: a hand can be at any place that covers its keys, and stays if possible.
    """
    ends = np.stack([high - above * KEY_SPACING, low + MIDDLE * KEY_SPACING])
    wide = ends[0] > ends[1]
    least, greatest = np.where(wide, ends.mean(axis=0), ends)
    before_least, before_greatest, end = states.T[..., None]
    way = np.maximum(np.maximum(least - before_greatest, before_least - greatest), 0)
    rest = np.maximum(onset - end, 0)
    cost = np.where(way > LEAP_DISTANCE, leap_steps(way, rest), 0.0)
    anew = (rest > LEAP_REST) | (way > 0)
    place = [
        np.where(anew, least, np.maximum(least, before_least)),
        np.where(anew, greatest, np.minimum(greatest, before_greatest)),
    ]
    return np.stack(place, axis=-1), cost
