"""Observation "hands": targets of each hand from the whole piece; the left hand is mirrored."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sb3_piano.arrays import Arrays, BoolArray, Float32Array, FloatArray, IntArray
from sb3_piano.envs.blocks import Block, Encoding, Now
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.encodings import (
    DM_PER_M,
    FARTHEST,
    JOINT_OVERSHOOT,
    JOINTS_MEANING,
    check_labels,
)
from sb3_piano.envs.observation import ObservationLayout
from sb3_piano.exceptions import ConfigError, PlanWarning
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import KEY_IS_BLACK, MIN_PITCH, NUM_KEYS
from sb3_piano.music.pitch import pitch_name
from sb3_piano.reading import KeyPlaces, Reading, both_hands, read_piece
from sb3_piano.reading.piece import HandReading, bounds_of
from sb3_piano.reading.presses import TimedPress
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import SIDES

HANDS_VERSION = 1
"""Version of the numbers in the blocks. A network fits one version; raise it with each change."""

FRAMES_AHEAD = np.array([1, 2, 3, 4, 6, 8])
"""Offsets of the states whose key frames are observed, in control steps."""

PLACES_AHEAD = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32])
"""Offsets of the states whose target places of the arm are observed, in control steps."""

BUSY_AHEAD = np.array([1, 6, 16])
"""Offsets of the states for which the observation says whether the hand plays, control steps."""

LINE_AHEAD = np.array([1, 4, 8, 16])
"""Offsets of the states whose bounds of the arm are observed, in control steps."""

PRESSES_AHEAD = 2
"""Observed presses of each finger: the present or next one, and the one after it."""

MOST_TIME = 2.0
"""Largest observed time to a press, ahead or back, s."""

CLIP = 10.0
"""Networks clip standardised observations here, so that no outlier dominates the others."""

_CM_PER_M = 100.0
_FULL_WEIGHT = 10.0  # of a key frame across the keys, per m
_FASTEST = 50.0  # rad/s, or m/s
_AROUND = np.array([-1, 0, 1])  # keys around a finger that are shown
_MARGIN = 1  # keys added beyond both ends of the keyboard, so that each key has neighbours
_GRID = 1e-3  # of the table of keys by place, m
_NAMED = 5  # notes in a warning


class HandEncoding(Encoding):
    """Observation of each hand's targets in the piece, relative to its arm and its fingers."""

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        """Lay out the observation.

        Raises:
            ConfigError: If forearms do more than slide along and across the keyboard.
        """
        dofs, expected = scene.options["forearm_dofs"], scene.hand.forearm_dofs()
        if dofs != expected:
            raise ConfigError(
                f"forearm_dofs is {list(dofs)}: the observation 'hands', and with it the "
                f"sight-reader, needs forearms that only slide: expected {list(expected)}."
            )
        self.hands = both_hands(scene)
        self.places = KeyPlaces.of(scene)
        self._control_timestep = config.control_timestep
        self._sides = [SIDES.index(name) for name in scene.sides]
        self.qpos = np.stack(scene.joint_qpos)
        self.dofs = np.stack([scene.model.jnt_dofadr[joints] for joints in scene.joints])
        self.tip_geoms = scene.fingertip_geom
        self.tip_along = np.concatenate([self.hands[i].tip_along for i in self._sides])[:, None]
        # In the mirrored left hand y and the slider along it change their signs.
        self.sign, self._fingers = _signs(scene), len(scene.hand.fingers)
        self.mirror = np.insert(np.ones((len(self.sign), 1, 2)), 1, self.sign, axis=2)
        shown = self.hands[self._sides[0]]  # the absent hand may have other joints
        self.slider = int(np.flatnonzero(self.qpos[0] == scene.slider_qpos[0])[0])
        self.joint_sign = np.ones(self.qpos.shape)
        self.joint_sign[:, self.slider] = self.sign[:, 0]
        self.slope = float(shown.arm_slope[shown.along])
        blocks = [kind(scene, config) for kind in _BLOCKS]
        self.keys = next(block for block in blocks if isinstance(block, _Keys))
        """The block of the keys."""
        of_hand = ObservationLayout(block.described() for block in blocks)
        self.at = {name: block.slice for name, block in of_hand.items()}
        """Place of each block among the numbers of a hand."""
        self._size = of_hand.size
        sides = [f"{side}_" for side in scene.sides]
        super().__init__(blocks, ObservationLayout(b.described(s) for s in sides for b in blocks))

    def split(self, numbers: Float32Array) -> list[Float32Array]:
        """Split observations, (..., n), into a view for each block, with all hands."""
        rows = numbers.reshape(*numbers.shape[:-1], -1, self._size)
        return [
            rows[..., self.at[block.name]].reshape(*rows.shape[:-1], *block.shape)
            for block in self._blocks
        ]

    def prepare(self, roll: PianoRoll) -> None:
        """Set the piece to play; see :meth:`Encoding.prepare`.

        A :class:`~sb3_piano.exceptions.PlanWarning` names notes without a finger, as hands have too
        few. These notes are not played.
        """
        if not (roll.finger >= 0).any():
            check_labels(roll, "hands")
        self.read(roll)
        left_out = [
            f"{pitch_name(MIN_PITCH + key)} (pitch {MIN_PITCH + key}) at "
            f"{step * self._control_timestep:.2f} s"
            for step, key in np.argwhere(roll.onset & roll.unlabelled).tolist()
        ]
        if left_out:
            more = f"; and {len(left_out) - _NAMED} more" if len(left_out) > _NAMED else ""
            warnings.warn(
                "Notes without a finger, which the hands leave out: "
                f"{'; '.join(left_out[:_NAMED])}{more}.",
                PlanWarning,
                stacklevel=2,
            )

    def read(self, roll: PianoRoll) -> Reading:
        """Set the piece without its notes that have no finger; return its reading."""
        read = read_piece(roll, self.hands, self.places)
        bounds = bounds_of(read.line, self.hands[0].spec.forearm.apart)
        hands = [read.hands[side] for side in self._sides]
        presses = np.stack([_shown_presses(hand, read.roll) for hand in hands], axis=1)
        piece = _Piece(roll.active, hands, [bounds[i] for i in self._sides], self.sign, presses)
        prepared = self._prepared(piece, len(roll))
        # Targets of the fingertips: first the key frames', then the presses'.
        frames = piece.ahead([hand.frames.target for hand in hands], FRAMES_AHEAD)
        target = np.concatenate([frames, presses[..., _POINT]], axis=2)
        asked = np.concatenate([piece.weight() > 0, presses[..., _THERE] > 0], axis=2)
        self._target = target * self.mirror[:, None] * DM_PER_M  # (T, h, 8, f, 3) dm
        self._scale = asked[..., None].astype(float)
        self._use(prepared)
        return read

    def tables(self) -> Arrays:
        """Return the data of the piece, with due keys padded by one at both ends."""
        rows = self.known_rows()
        known = rows.reshape(len(rows), -1, self._size)
        return {**super().tables(), "known": known, "target": self._target, "scale": self._scale}

    def _look(self, now: Now) -> _Moment:
        """Compute the inputs that blocks share: joints, arms and fingertips, mirrored."""
        simulation, data = now.simulation, now.simulation.data
        joints = simulation.qpos[self.qpos] * self.joint_sign
        # (h, 1): with the sliders at 0 both hands are equally far from the middle.
        arm = (self.hands[0].middle + self.slope * joints[:, self.slider])[:, None] * DM_PER_M
        alone = len(arm) == 1  # the absent hand counts as at rest
        axes = data.geom_xmat.take(self.tip_geoms, axis=0)[:, 2::3]
        tips = simulation.geom_xpos.take(self.tip_geoms, axis=0) + axes * self.tip_along
        tips = tips.reshape(-1, self._fingers, 3) * self.mirror
        here = tips * DM_PER_M
        return _Moment(
            step=now.step,
            key_state=simulation.key_state,
            joints=joints,
            velocities=data.qvel[self.dofs] * self.joint_sign,
            arm=arm,
            other_arm=self.hands[0].middle * DM_PER_M if alone else arm[::-1],
            tips=tips,
            tips_dm=here,
            ways=(self._target[now.step] - here[:, None]) * self._scale[now.step],
        )


def _signs(scene: PianoScene) -> FloatArray:
    """Return -1 for the left hand and 1 for the right hand, (h, 1)."""
    return np.array([[1.0 if side == "right" else -1.0] for side in scene.sides])


@dataclass(frozen=True, eq=False)
class _Piece:
    """Reading of a piece of T control steps for the h hands in the scene."""

    due: BoolArray  # (T, 88) keys that should sound
    hands: list[HandReading]
    bounds: list[FloatArray]  # (T + 1,) place beyond which each arm must stay, m
    sign: FloatArray  # (h, 1)
    presses: FloatArray  # (T, h, 2, f, 13), see _shown_presses

    def ahead(self, values: list[Any], states: IntArray) -> FloatArray:
        """Look up hands' values, (T + 1, ...), at n offsets from each state, (T, h, n, ...)."""
        steps = len(self.due)
        shown = np.minimum(np.arange(steps)[:, None] + states, steps)  # the last state repeats
        return np.stack([of_hand[shown] for of_hand in values], axis=1)

    def weight(self) -> FloatArray:
        """Return the weights of the key frames across the keys, (T, h, 6, f) per m."""
        return self.ahead([hand.frames.weight[..., 1] for hand in self.hands], FRAMES_AHEAD)


class _Moment(NamedTuple):
    """State of the h hands before a control step, with the left hand mirrored."""

    step: int
    key_state: FloatArray  # (88,) key angles over their largest angles
    joints: FloatArray  # (h, m) rad, or m
    velocities: FloatArray  # (h, m) rad/s, or m/s
    arm: FloatArray  # (h, 1) place to the little finger's side, dm
    other_arm: FloatArray | float  # place of the other arm to its own side, dm
    tips: FloatArray  # (h, f, 3) fingertips, m
    tips_dm: FloatArray
    # (h, 8, f, 3) from fingertips to their targets in key frames and presses, dm; 0 without target
    ways: FloatArray


class _Positions(Block):
    name = "positions"
    unit = "rad, m of sliders"
    meaning = JOINTS_MEANING

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        low, high = scene.joint_range[0].T  # those of the mirrored left hand, too
        self.shape = (len(low),)
        self.low, self.high = low - JOINT_OVERSHOOT, high + JOINT_OVERSHOOT

    def write(self, out: Float32Array, now: _Moment) -> None:
        out[:] = now.joints


class _Velocities(Block):
    name = "velocities"
    unit = "rad/s, m/s of sliders"
    meaning = f"velocities of the joint positions, clipped at {_FASTEST:g}"
    low, high = -_FASTEST, _FASTEST

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        self.shape = (len(scene.joints[0]),)

    def write(self, out: Float32Array, now: _Moment) -> None:
        out[:] = np.minimum(np.maximum(now.velocities, -_FASTEST), _FASTEST)


class _Fingertips(Block):
    name = "fingertips"
    unit = "dm"
    meaning = (
        "centres of the fingertips, thumb to little finger: x towards the player, y from the arm "
        "to the little finger's side, z up"
    )
    low, high = -FARTHEST, FARTHEST

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        self.shape = (len(scene.hand.fingers), 3)

    def write(self, out: Float32Array, now: _Moment) -> None:
        out[:] = now.tips_dm
        out[:, :, 1] = now.tips_dm[:, :, 1] - now.arm


def _listed(numbers: IntArray) -> str:
    *first, last = numbers.tolist()
    return f"{', '.join(map(str, first))} and {last}"


class _Frames(Block):
    name = "frames"
    unit = "dm (3), 1"
    meaning = (
        f"for the states after {_listed(FRAMES_AHEAD)} control steps and each finger: the vector "
        "from the present position of its tip to the target, and the target's weight; 0 without a "
        "target"
    )
    low = (*[-FARTHEST] * 3, 0.0)
    high = (*[FARTHEST] * 3, 10.0)

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        self.shape = (len(FRAMES_AHEAD), len(scene.hand.fingers), 4)

    def prepare(self, piece: _Piece) -> FloatArray:
        weight = piece.weight()
        known = np.zeros((*weight.shape, 4))
        known[..., 3] = weight / _FULL_WEIGHT
        return known

    def write(self, out: Float32Array, now: _Moment) -> None:
        out[..., :3] = now.ways[:, : len(FRAMES_AHEAD)]


class _Presses(Block):
    name = "presses"
    unit = "dm (3), 1, s (2), 1 (5), s (2)"
    meaning = (
        "for each finger's present or next press, then the one after it: the vector to the place "
        "of its tip when the key is down; the key's angle over its largest angle; times until the "
        "planned press begins and ends, negative if past, clipped at "
        f"{MOST_TIME:g}; 1 if the finger has such a press, if the key is black, if the hand leaps "
        "before it, if it leaps after it, if the finger strikes the same key again at once; times "
        "until the written note begins and ends, which leaps can shorten in the plan"
    )
    low = (*[-FARTHEST] * 3, 0.0, -MOST_TIME, -MOST_TIME, *[0.0] * 5, -MOST_TIME, -MOST_TIME)
    high = (*[FARTHEST] * 3, 1.0, MOST_TIME, MOST_TIME, *[1.0] * 5, MOST_TIME, MOST_TIME)

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        self._timestep = config.control_timestep
        self.shape = (PRESSES_AHEAD, len(scene.hand.fingers), 13)

    def prepare(self, piece: _Piece) -> FloatArray:
        presses = piece.presses
        self._key, self._there = presses[..., _KEY].astype(np.intp), presses[..., _THERE] > 0
        there, steps = self._there[..., None], np.arange(len(presses))
        now = (steps * self._timestep)[:, None, None, None, None]
        known = np.zeros(presses.shape)
        times = presses[..., _TIMES] * self._timestep
        known[..., 4:6] = np.clip(times, -MOST_TIME, MOST_TIME) * there
        known[..., 6:11] = presses[..., _FACTS]
        known[..., 11:] = np.clip(presses[..., _WRITTEN] - now, -MOST_TIME, MOST_TIME) * there
        return known

    def tables(self) -> Arrays:
        return {"press_key": self._key, "press_there": self._there}

    def write(self, out: Float32Array, now: _Moment) -> None:
        out[..., :3] = now.ways[:, len(FRAMES_AHEAD) :]
        out[..., 3] = now.key_state[self._key[now.step]] * self._there[now.step]


class _Keys(Block):
    name = "keys"
    unit = "1 (9), cm"
    meaning = (
        "for the key nearest to each fingertip and its neighbours on the thumb's and on the little "
        "finger's side (in the order neighbour, key, neighbour): angles over their largest angles; "
        "1 if due; 1 if black; then the distance from the fingertip to the nearest key, positive "
        "to the little finger's side"
    )
    low = (*[0.0] * 9, -200.0)
    high = (*[1.0] * 9, 200.0)

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        places, sign = KeyPlaces.of(scene).y, _signs(scene)
        self.shape = (len(scene.hand.fingers), 10)
        self._places, self._sign = places, sign
        # The nearest key for each millimetre across the keyboard, and the start of the grid, m.
        cells = np.arange(places[0], places[-1], _GRID) + _GRID / 2
        self.nearest = np.abs(cells[:, None] - places).argmin(axis=1)
        self.lowest = float(places[0])
        self.black = np.pad(KEY_IS_BLACK.astype(np.float32), _MARGIN)
        self.around = (_AROUND * sign.astype(np.intp))[:, None] + _MARGIN  # (h, 1, 3)
        self._state = np.zeros(NUM_KEYS + 2 * _MARGIN)

    def prepare(self, piece: _Piece) -> None:
        self._due = np.pad(piece.due, ((0, 0), (_MARGIN, _MARGIN))).astype(np.float32)

    def tables(self) -> Arrays:
        return {"due": self._due}

    def write(self, out: Float32Array, now: _Moment) -> None:
        across = now.tips[:, :, 1] * self._sign  # (h, f) in the world
        cells = ((across - self.lowest) * (1 / _GRID)).astype(np.intp)
        key = self.nearest.take(cells, mode="clip")
        around = key[:, :, None] + self.around
        self._state[_MARGIN:-_MARGIN] = now.key_state
        out[..., 0:3] = self._state[around]
        out[..., 3:6] = self._due[now.step][around]
        out[..., 6:9] = self.black[around]
        out[..., 9] = _CM_PER_M * (self._places[key] - across) * self._sign


class _Places(Block):
    name = "places"
    shape = PLACES_AHEAD.shape
    unit = "dm"
    meaning = (
        "target place of the hand relative to the arm, positive to the little finger's side, in "
        f"the states after {_listed(PLACES_AHEAD)} control steps"
    )
    low, high = -FARTHEST, FARTHEST

    def prepare(self, piece: _Piece) -> FloatArray:
        places = piece.ahead([hand.place for hand in piece.hands], PLACES_AHEAD)
        return DM_PER_M * piece.sign * places

    def write(self, out: Float32Array, now: _Moment) -> None:
        out -= now.arm


class _Busy(Block):
    name = "busy"
    shape = BUSY_AHEAD.shape
    meaning = f"1 if the hand plays at about {_listed(BUSY_AHEAD)} control steps from now"
    binary = True

    def prepare(self, piece: _Piece) -> FloatArray:
        return piece.ahead([hand.busy for hand in piece.hands], BUSY_AHEAD)


class _Line(Block):
    name = "line"
    shape = LINE_AHEAD.shape
    unit = "dm"
    meaning = (
        "bound that the arm must stay beyond, relative to the arm, positive to the little finger's "
        f"side, in the states after {_listed(LINE_AHEAD)} control steps"
    )
    low, high = -FARTHEST, FARTHEST

    def prepare(self, piece: _Piece) -> FloatArray:
        return DM_PER_M * piece.sign * piece.ahead(piece.bounds, LINE_AHEAD)

    def write(self, out: Float32Array, now: _Moment) -> None:
        out -= now.arm


class _OtherArm(Block):
    name = "other_arm"
    unit = "dm"
    meaning = "distance from the left arm to the right arm, positive to the right"
    low, high = -FARTHEST, FARTHEST

    def write(self, out: Float32Array, now: _Moment) -> None:
        out[:] = now.arm + now.other_arm


_BODY = (_Positions, _Velocities, _Fingertips)
_MUSIC = (_Frames, _Presses, _Keys, _Places, _Busy, _Line, _OtherArm)
_BLOCKS = (*_BODY, *_MUSIC)
"""Blocks of a hand in order."""

_KEY, _TIMES, _POINT, _THERE = 0, slice(1, 3), slice(3, 6), 6
_FACTS, _WRITTEN, _COLUMNS = slice(6, 11), slice(11, 13), 13


def _shown_presses(hand: HandReading, roll: PianoRoll) -> FloatArray:
    """Tabulate each finger's present or next press and the one after it, in each of T states.

    Returns:
        (T, 2, f, 13): the key; states until the first and the last one in which it must be down,
        negative if past; place of the fingertip when the key is down, m; 1 if the finger has such a
        press, if the key is black, if the hand leaps before it, if it leaps after it, if the finger
        strikes the same key again at once; begin and end of the written note, s from the start.
        All 0 without such a press.
    """
    steps, fingers = len(roll), hand.frames.target.shape[1]
    onsets = {(step, key): time for step, key, time in roll.strikes()}
    shown = np.zeros((steps, PRESSES_AHEAD, fingers, _COLUMNS))
    states = np.arange(steps)
    for finger in range(fingers):
        own = [one for one in hand.presses if one.press.finger == finger]
        ends = np.maximum.accumulate([one.last for one in own] or [0])
        following = np.searchsorted(ends, states + 1) if own else np.zeros(steps, np.intp)
        table = _table(own, hand, onsets, roll.control_timestep)
        for ahead in range(PRESSES_AHEAD):
            at = following + ahead
            there = at < len(own)
            shown[there, ahead, finger] = table[at[there]]
            shown[there, ahead, finger, _TIMES] -= states[there, None]
    return shown


def _table(
    presses: list[TimedPress],
    hand: HandReading,
    onsets: dict[tuple[int, int], float],
    control_timestep: float,
) -> FloatArray:
    """Return a row for each press of a finger, with the columns of _shown_presses."""
    table = np.zeros((len(presses), _COLUMNS))
    for row, one in zip(table, presses, strict=True):
        key, finger = one.press.key, one.press.finger
        start = one.press.first - 1  # the control step that leads to the first state
        row[_KEY], row[_TIMES] = key, (one.first, one.last)
        row[_POINT] = hand.frames.target[min(one.first, len(hand.place) - 1), finger]
        row[_FACTS] = True, KEY_IS_BLACK[key], one.leapt, one.leaps, one.repeated
        onset = onsets.get((start, key), start * control_timestep)
        row[_WRITTEN] = onset, one.press.last * control_timestep
    return table
