"""Targets of a hand's fingertips on the keys, state by state, m.

World coordinates: x points from the keys' hinges to the player, y to the right, z up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.music.constants import KEY_IS_BLACK, THUMB
from sb3_piano.music.dynamics import TRAVEL, speed_of
from sb3_piano.music.fingering.leaps import TimedPress
from sb3_piano.music.fingering.robot import hand_place
from sb3_piano.simulation import PianoScene

WHITE_X = (0.052, 0.042)
"""Press points of thumbs and of other fingers along white keys, m."""
_MIXED_X = (0.040, 0.026)  # the same while the hand plays keys of the other colour, too
_BLACK_X = (0.002, -0.002)  # the same on black keys

HOVER = 0.010
"""Height of a finger over its next key, m."""
HOLD_DEPTH = 1.05
"""Depth of a key while it is down, a share of its travel."""

# Ranks of targets: a higher one replaces a lower one. A release precedes the next approach.
_HOVER, _LIFT, _READY, _RELEASE, _HOLD = range(1, 6)

_HOVER_STATES = 8  # number of states in which a finger hovers over its next key
_REACH = 0.06  # distance of a hand from a key within which a finger moves towards it, m

# Depths of a key: two states before it is down; one state before, pressed but not yet sounding; one
# state before after a leap, with less time; between two strikes by the same finger without a state
# between; one state after it was down; the same before a leap.
_LIFT_DEPTH, _READY_DEPTH, _LEAP_READY_DEPTH = -0.5, 0.6, -0.2
_REPEAT_DEPTH, _RELEASE_DEPTH, _LEAP_RELEASE_DEPTH = 0.45, 0.2, -1.2
# With dynamics: the least depth one state before, for loud notes, and the most after a leap.
_LOUD_READY_DEPTH, _SOFT_LEAP_READY_DEPTH = -1.0, 0.3

# Weights along x, y and z, per m, relative to about 0.01 per rad of posture. Black keys weigh more
# along x, as fingers slip off. With less along z, thumbs are some 3 mm too high to press keys down.
_WEIGHT, _WEIGHT_BLACK = np.array([4.0, 10.0, 20.0]), np.array([20.0, 10.0, 20.0])

# Weights of the targets, as shares of these.
_READY_SHARE = 0.8
_LIFT_SHARE = 0.6
_LEAST_HOVER_SHARE = 0.1
_RELEASE_SHARE = np.array([0.1, 1.0, 0.8])
_LEAP_RELEASE_SHARE = np.array([0.1, 0.5, 0.8])

# A passage is mixed if keys of the other colour are played within so many states.
_MIXED_STATES = 3


@dataclass(frozen=True, eq=False)
class KeyPlaces:
    """Geometry of the keys at rest, in the world."""

    y: FloatArray
    """(88,) centres across the keyboard, m."""
    top: FloatArray
    """(88,) height of the tops, m."""
    hinge: FloatArray
    """(88,) positions of the hinges along x, m."""
    max_angle: FloatArray
    """(88,) angle when fully down, rad."""
    holding_torque: FloatArray
    """(88,) torque of the springs when fully down, N m; rigid keys get a moving key's."""

    @classmethod
    def of(cls, scene: PianoScene) -> KeyPlaces:
        """Read the geometry from a scene."""
        data = mujoco.MjData(scene.model)
        mujoco.mj_kinematics(scene.model, data)
        centre, half = data.geom_xpos[scene.key_geom], scene.model.geom_size[scene.key_geom]
        # Keys are the first joints of their bodies, and have no other.
        joints = scene.model.body_jntadr[scene.model.geom_bodyid[scene.key_geom[scene.moving_keys]]]
        turn = scene.key_max_angle[scene.moving_keys] - scene.model.qpos_spring[scene.key_qpos]
        stiffness = np.asarray(scene.model.jnt_stiffness[joints]).reshape(len(joints), -1)[:, 0]
        torque = np.full(len(half), np.max(stiffness * turn))
        torque[scene.moving_keys] = stiffness * turn
        return cls(
            y=centre[:, 1].copy(),
            top=centre[:, 2] + half[:, 2],
            hinge=centre[:, 0] - half[:, 0],
            max_angle=scene.key_max_angle,
            holding_torque=torque,
        )

    def height(self, key: int, x: float, depth: float) -> float:
        """Compute the height of a key's top at ``x``, m; ``depth`` is a share of its travel."""
        drop = (x - self.hinge[key]) * np.tan(depth * self.max_angle[key])
        return float(self.top[key] - drop)


class KeyFrames(NamedTuple):
    """Targets of a hand's f fingertips over s states; state 0 is the start."""

    target: FloatArray
    """(s, f, 3) places, m."""
    weight: FloatArray
    """(s, f, 3) weights, per m; 0 for fingers without a target."""
    on_black: BoolArray
    """(s, f) fingers that press a black key, or are about to."""
    to_black: BoolArray
    """(s, f) fingers that move to a black key, or from it."""

    def between(self, start: int, stop: int | None) -> KeyFrames:
        """Return the targets of the states from ``start`` to ``stop``."""
        return KeyFrames._make(array[start:stop] for array in self)


def key_frames(
    timed: Sequence[TimedPress],
    sign: int,
    n_states: int,
    radius: FloatArray,
    keys: KeyPlaces,
    hover: float = HOVER,
    hold_depth: float = HOLD_DEPTH,
    loudness_step: float = 0.0,
) -> KeyFrames:
    """Compute the fingertips' targets from a hand's presses.

    Args:
        timed: The presses, in order of time.
        sign: 1 for the right hand, -1 for the left hand.
        n_states: Number of states.
        radius: (f,) radius of the fingertips, m.
        keys: The keyboard.
        hover: Value in place of :data:`HOVER`.
        hold_depth: Value in place of :data:`HOLD_DEPTH`.
        loudness_step: Length of a state, s, for fingers that strike from as far as the notes'
            velocities ask for; 0 if strikes are equal.
    """
    shape = (n_states, len(radius))
    vectors, flags = (np.zeros((2, *shape, 3)), np.zeros((2, *shape), dtype=bool))
    frames, rank = KeyFrames(*vectors, *flags), np.zeros(shape, dtype=int)
    places = [hand_place(one.press.key, one.press.finger, sign) for one in timed]
    # Fingers that hold keys in each state, each with its place of the hand.
    held: list[list[tuple[int, float]]] = [[] for _ in range(n_states)]
    for one, place in zip(timed, places, strict=True):
        for state in range(one.first, min(one.last + 1, n_states)):
            held[state].append((one.press.finger, place))
    last = [0] * len(radius)  # last state of each finger's previous note
    for one, place, mixed in zip(timed, places, _mixed(timed), strict=True):
        key, finger = one.press.key, one.press.finger
        start = max(last[finger] + 2, one.first - _HOVER_STATES, 0)
        last[finger] = max(last[finger], one.last)
        free = [  # states in which no other finger holds the hand too far away
            state
            for state in range(start, min(one.first - 1, n_states))
            if all(abs(place - at) <= _REACH for other, at in held[state] if other != finger)
        ]
        along = _BLACK_X if KEY_IS_BLACK[key] else _MIXED_X if mixed else WHITE_X
        x = along[finger != THUMB]
        full = _WEIGHT_BLACK if KEY_IS_BLACK[key] else _WEIGHT
        ready = _ready_depth(one, hold_depth, loudness_step)
        for state, level, depth, above, share in _targets(one, free, hover, hold_depth, ready):
            if 0 < state < n_states and level >= rank[state, finger]:
                height = keys.height(key, x, depth) + float(radius[finger]) + above
                frames.target[state, finger] = x, keys.y[key], height
                frames.weight[state, finger] = full * share
                rank[state, finger] = level
        if KEY_IS_BLACK[key]:
            frames.to_black[max(one.first - _HOVER_STATES, 0) : one.last + 2, finger] = True
            frames.on_black[max(one.first - 1, 0) : one.last + 1, finger] = True
    return frames


def _targets(
    one: TimedPress, free: Sequence[int], hover: float, hold_depth: float, ready: float
) -> Iterator[tuple[int, int, float, float, FloatArray | float]]:
    """Yield the targets of a finger's approach to a key in ``free`` states, its hold and release.

    Yields:
        State, rank, depth of the key, height over that, m, and weight.
    """
    strike = one.first - 1  # the state before the key is down
    for state in free:
        if state < strike - 1:
            near = 1 - (strike - state) / _HOVER_STATES
            yield state, _HOVER, 0.0, hover, max(_LEAST_HOVER_SHARE, near**3)
        else:
            yield state, _LIFT, _LIFT_DEPTH, 0.0, _LIFT_SHARE
    yield strike, _READY, ready, 0.0, _READY_SHARE
    for state in range(one.first, one.last + 1):
        yield state, _HOLD, hold_depth, 0.0, 1.0
    depth = _LEAP_RELEASE_DEPTH if one.leaps else _RELEASE_DEPTH
    share = _LEAP_RELEASE_SHARE if one.leaps else _RELEASE_SHARE
    yield one.last + 1, _RELEASE, _REPEAT_DEPTH if one.repeated else depth, 0.0, share


def _ready_depth(one: TimedPress, hold_depth: float, loudness_step: float) -> float:
    """Return the depth one state before a key is down.

    With dynamics the way from there to ``hold_depth`` is that of a key at the note's speed.
    """
    velocity, key = one.press.velocity, one.press.key
    if not (loudness_step and velocity):
        return _LEAP_READY_DEPTH if one.leapt else _READY_DEPTH
    depth = hold_depth - speed_of(velocity, key) * loudness_step / float(TRAVEL[key])
    most = _SOFT_LEAP_READY_DEPTH if one.leapt else _READY_DEPTH
    return min(max(depth, _LOUD_READY_DEPTH), most)


def _mixed(timed: Sequence[TimedPress]) -> list[bool]:
    """Check for each press whether its hand plays keys of the other colour at about that time."""
    rows = [(one.press.first, one.press.last, KEY_IS_BLACK[one.press.key]) for one in timed]
    first, last, black = np.array(rows, dtype=int).reshape(-1, 3).T
    near = (first <= last[:, None] + _MIXED_STATES) & (last >= first[:, None] - _MIXED_STATES)
    return np.asarray((near & (black != black[:, None])).any(axis=1)).tolist()
