"""Observation "hands": targets of each hand from the whole piece; the left hand is mirrored."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sb3_piano.arrays import Arrays, Float32Array, FloatArray, IntArray
from sb3_piano.envs.blocks import Encoding, Now, Write
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.encodings import (
    DM_PER_M,
    FARTHEST,
    JOINT_OVERSHOOT,
    JOINTS_MEANING,
    Blocks,
    check_labels,
)
from sb3_piano.envs.observation import ObservationBlock, ObservationLayout
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

FASTEST = 50.0
"""Largest observed velocity, rad/s, or m/s."""

CLIP = 10.0
"""Networks clip standardised observations here, so that no outlier dominates the others."""

_CM_PER_M = 100.0
_FULL_WEIGHT = 10.0  # of a key frame across the keys, per m
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
        self.hands, self.places = both_hands(scene), KeyPlaces.of(scene)
        self._timestep = config.control_timestep
        self._sides = [SIDES.index(name) for name in scene.sides]
        self.qpos = np.stack(scene.joint_qpos)
        self.dofs = np.stack([scene.model.jnt_dofadr[joints] for joints in scene.joints])
        self.tip_geoms, self._fingers = scene.fingertip_geom, len(scene.hand.fingers)
        self.tip_along = np.concatenate([self.hands[i].tip_along for i in self._sides])[:, None]
        # In the mirrored left hand y and the slider along it change their signs.
        self.sign = np.array([[float(self.hands[i].sign)] for i in self._sides])
        self.mirror = np.insert(np.ones((len(self.sign), 1, 2)), 1, self.sign, axis=2)
        shown = self.hands[self._sides[0]]  # the absent hand may have other joints
        self.slider = int(np.flatnonzero(self.qpos[0] == scene.slider_qpos[0])[0])
        self.joint_sign = np.ones(self.qpos.shape)
        self.joint_sign[:, self.slider] = self.sign[:, 0]
        self.slope = float(shown.arm_slope[shown.along])
        # The nearest key for each millimetre across the keyboard, and the start of the grid, m.
        self.lowest, highest = self.places.y[[0, -1]].tolist()
        cells = np.arange(self.lowest, highest, _GRID) + _GRID / 2
        self.nearest = np.abs(cells[:, None] - self.places.y).argmin(axis=1)
        self.black = np.pad(KEY_IS_BLACK.astype(np.float32), _MARGIN)
        self.around = (_AROUND * self.sign.astype(np.intp))[:, None] + _MARGIN  # (h, 1, 3)
        self._key_state = np.zeros(NUM_KEYS + 2 * _MARGIN)
        blocks = self._of_hand(*scene.joint_range[0].T)  # also of the mirrored left hand
        of_hand = ObservationLayout(block for block, _ in blocks)
        self.at = {name: block.slice for name, block in of_hand.items()}
        """Place of each block among the numbers of a hand."""
        self._size = of_hand.size
        named = [replace(b, name=f"{side}_{b.name}") for side in scene.sides for b, _ in blocks]
        super().__init__(blocks, ObservationLayout(named))

    def _of_hand(self, lowest: FloatArray, highest: FloatArray) -> Blocks:
        """List the blocks of a hand; their functions write the numbers of all hands."""
        far, late, fingers, blocks = FARTHEST, MOST_TIME, self._fingers, Blocks()

        def add(
            write: Write | None, low: Any = -far, high: Any = far, unit: str = "dm", **facts: Any
        ) -> None:
            block = ObservationBlock(low=low, high=high, unit=unit, binary=write is None, **facts)
            blocks.append((block, write))

        low, high, joints = lowest - JOINT_OVERSHOOT, highest + JOINT_OVERSHOOT, lowest.shape
        unit, meaning = "rad, m of sliders", JOINTS_MEANING
        add(_write_positions, low, high, unit, name="positions", shape=joints, meaning=meaning)
        add(
            _write_velocities,
            -FASTEST,
            FASTEST,
            "rad/s, m/s of sliders",
            name="velocities",
            shape=joints,
            meaning=f"velocities of the joint positions, clipped at {FASTEST:g}",
        )
        add(
            _write_fingertips,
            name="fingertips",
            shape=(fingers, 3),
            meaning="centres of the fingertips, thumb to little finger: x towards the player, y "
            "from the arm to the little finger's side, z up",
        )
        add(
            _write_frames,
            (*[-far] * 3, 0.0),
            (*[far] * 3, 10.0),
            "dm (3), 1",
            name="frames",
            shape=(len(FRAMES_AHEAD), fingers, 4),
            meaning=f"for the states after {_listed(FRAMES_AHEAD)} control steps and each finger: "
            "the vector from the present position of its tip to the target, and the target's "
            "weight; 0 without a target",
        )
        add(
            _write_presses,
            (*[-far] * 3, 0.0, -late, -late, *[0.0] * 5, -late, -late),
            (*[far] * 3, 1.0, late, late, *[1.0] * 5, late, late),
            "dm (3), 1, s (2), 1 (5), s (2)",
            name="presses",
            shape=(PRESSES_AHEAD, fingers, _COLUMNS),
            meaning="for each finger's present or next press, then the one after it: the vector to "
            "the place of its tip when the key is down; the key's angle over its largest angle; "
            "times until the planned press begins and ends, negative if past, clipped at "
            f"{late:g}; 1 if the finger has such a press, if the key is black, if the hand leaps "
            "before it, if it leaps after it, if the finger strikes the same key again at once; "
            "times until the written note begins and ends, which leaps can shorten in the plan",
        )
        add(
            self._write_keys,
            (*[0.0] * 9, -200.0),
            (*[1.0] * 9, 200.0),
            "1 (9), cm",
            name="keys",
            shape=(fingers, 10),
            meaning="for the key nearest to each fingertip and its neighbours on the thumb's and "
            "on the little finger's side (in the order neighbour, key, neighbour): angles over "
            "their largest angles; 1 if due; 1 if black; then the distance from the fingertip to "
            "the nearest key, positive to the little finger's side",
        )
        add(
            _write_from_arm,
            name="places",
            shape=PLACES_AHEAD.shape,
            meaning="target place of the hand relative to the arm, positive to the little finger's "
            f"side, in the states after {_listed(PLACES_AHEAD)} control steps",
        )
        meaning = f"1 if the hand plays at about {_listed(BUSY_AHEAD)} control steps from now"
        add(None, 0.0, 1.0, "1", name="busy", shape=BUSY_AHEAD.shape, meaning=meaning)
        add(
            _write_from_arm,
            name="line",
            shape=LINE_AHEAD.shape,
            meaning="bound that the arm must stay beyond, relative to the arm, positive to the "
            f"little finger's side, in the states after {_listed(LINE_AHEAD)} control steps",
        )
        meaning = "distance from the left arm to the right arm, positive to the right"
        add(_write_other_arm, name="other_arm", shape=(1,), meaning=meaning)
        return blocks

    def split(self, numbers: Float32Array) -> list[Float32Array]:
        """Split observations, (..., n), into a view for each block, with all hands."""
        rows = numbers.reshape(*numbers.shape[:-1], -1, self._size)
        return [
            rows[..., self.at[block.name]].reshape(*rows.shape[:-1], *block.shape)
            for block, _ in self._blocks
        ]

    def prepare(self, roll: PianoRoll) -> None:
        """Set the piece to play; see :meth:`Encoding.prepare`.

        A :class:`~sb3_piano.exceptions.PlanWarning` names notes without a finger, as hands have too
        few. These notes are not played.
        """
        if not (roll.finger >= 0).any():
            check_labels(roll, "hands")
        self.read(roll)
        missing = np.argwhere(roll.onset & roll.unlabelled) * [self._timestep, 1] + [0, MIN_PITCH]
        left_out = [
            f"{pitch_name(int(pitch))} (pitch {pitch:.0f}) at {time:.2f} s"
            for time, pitch in missing.tolist()
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
        hands, steps = [read.hands[side] for side in self._sides], np.arange(len(roll))
        presses = np.stack([_shown_presses(hand, read.roll) for hand in hands], axis=1)

        def ahead(values: list[Any], states: IntArray) -> FloatArray:
            """Look up hands' values, (T + 1, ...), at n offsets from each state, (T, h, n, ...)."""
            shown = np.minimum(steps[:, None] + states, len(roll))  # the last state repeats
            return np.stack([of_hand[shown] for of_hand in values], axis=1)

        weight = ahead([hand.frames.weight[..., 1] for hand in hands], FRAMES_AHEAD)  # per m
        frames = np.zeros((*weight.shape, 4))
        frames[..., 3] = weight / _FULL_WEIGHT
        there = presses[..., _THERE, None] > 0
        now = steps[:, None, None, None, None] * self._timestep
        self._press_key, self._there = presses[..., _KEY].astype(np.intp), there[..., 0]
        shown = np.zeros(presses.shape)
        times = presses[..., _TIMES] * self._timestep
        shown[..., 4:6] = np.clip(times, -MOST_TIME, MOST_TIME) * there
        shown[..., 6:11] = presses[..., _FACTS]
        shown[..., 11:] = np.clip(presses[..., _WRITTEN] - now, -MOST_TIME, MOST_TIME) * there
        # Targets of the fingertips: first the key frames', then the presses'.
        target = ahead([hand.frames.target for hand in hands], FRAMES_AHEAD)
        target = np.concatenate([target, presses[..., _POINT]], axis=2)
        self._target = target * self.mirror[:, None] * DM_PER_M  # (T, h, 8, f, 3) dm
        asked = np.concatenate([weight > 0, self._there], axis=2)
        self._scale = asked[..., None].astype(float)
        self._due = np.pad(roll.active, ((0, 0), (_MARGIN, _MARGIN))).astype(np.float32)
        line = ahead([bounds[side] for side in self._sides], LINE_AHEAD)
        places = ahead([hand.place for hand in hands], PLACES_AHEAD)
        known = {"frames": frames, "presses": shown, "places": DM_PER_M * self.sign * places}
        busy = ahead([hand.busy for hand in hands], BUSY_AHEAD)
        self._use({**known, "busy": busy, "line": DM_PER_M * self.sign * line})
        return read

    def tables(self) -> Arrays:
        """Return the data of the piece, with due keys padded by one at both ends."""
        rows = self.known_rows()
        return {
            "press_key": self._press_key,
            "press_there": self._there,
            "due": self._due,
            "known": rows.reshape(len(rows), -1, self._size),
            "target": self._target,
            "scale": self._scale,
        }

    def _look(self, now: Now) -> _Moment:
        """Compute the inputs that blocks share: joints, arms and fingertips, mirrored."""
        simulation, data, step = now.simulation, now.simulation.data, now.step
        joints = simulation.qpos[self.qpos] * self.joint_sign
        # (h, 1): with the sliders at 0 both hands are equally far from the middle.
        arm = (self.hands[0].middle + self.slope * joints[:, self.slider])[:, None] * DM_PER_M
        alone = len(arm) == 1  # the absent hand counts as at rest
        axes = data.geom_xmat.take(self.tip_geoms, axis=0)[:, 2::3]
        tips = simulation.geom_xpos.take(self.tip_geoms, axis=0) + axes * self.tip_along
        tips = tips.reshape(-1, self._fingers, 3) * self.mirror
        here = tips * DM_PER_M
        return _Moment(
            step=step,
            joints=joints,
            velocities=data.qvel[self.dofs] * self.joint_sign,
            arm=arm,
            other_arm=self.hands[0].middle * DM_PER_M if alone else arm[::-1],
            tips=tips,
            tips_dm=here,
            ways=(self._target[step] - here[:, None]) * self._scale[step],
            depths=simulation.key_state[self._press_key[step]] * self._there[step],
            key_state=simulation.key_state,
        )

    def _write_keys(self, out: Float32Array, now: _Moment) -> None:
        across = now.tips[:, :, 1] * self.sign  # (h, f) in the world
        cells = ((across - self.lowest) * (1 / _GRID)).astype(np.intp)
        key = self.nearest.take(cells, mode="clip")
        around = key[:, :, None] + self.around
        self._key_state[_MARGIN:-_MARGIN] = now.key_state
        out[..., 0:3] = self._key_state[around]
        out[..., 3:6] = self._due[now.step][around]
        out[..., 6:9] = self.black[around]
        out[..., 9] = _CM_PER_M * (self.places.y[key] - across) * self.sign


class _Moment(NamedTuple):
    """State of the h hands before a control step, with the left hand mirrored."""

    step: int
    joints: FloatArray  # (h, m) rad, or m
    velocities: FloatArray  # (h, m) rad/s, or m/s
    arm: FloatArray  # (h, 1) place to the little finger's side, dm
    other_arm: FloatArray | float  # place of the other arm to its own side, dm
    tips: FloatArray  # (h, f, 3) fingertips, m
    tips_dm: FloatArray
    # (h, 8, f, 3) from fingertips to their targets in key frames and presses, dm; 0 without target
    ways: FloatArray
    depths: FloatArray  # (h, 2, f) angles of the presses' keys over their largest angles
    key_state: FloatArray  # (88,) the same of all keys


def _write_positions(out: Float32Array, now: _Moment) -> None:
    out[:] = now.joints


def _write_velocities(out: Float32Array, now: _Moment) -> None:
    out[:] = np.minimum(np.maximum(now.velocities, -FASTEST), FASTEST)


def _write_fingertips(out: Float32Array, now: _Moment) -> None:
    out[:] = now.tips_dm
    out[:, :, 1] = now.tips_dm[:, :, 1] - now.arm


def _write_frames(out: Float32Array, now: _Moment) -> None:
    out[..., :3] = now.ways[:, : len(FRAMES_AHEAD)]


def _write_presses(out: Float32Array, now: _Moment) -> None:
    out[..., :3] = now.ways[:, len(FRAMES_AHEAD) :]
    out[..., 3] = now.depths


def _write_from_arm(out: Float32Array, now: _Moment) -> None:
    out -= now.arm


def _write_other_arm(out: Float32Array, now: _Moment) -> None:
    out[:] = now.arm + now.other_arm


def _listed(numbers: IntArray) -> str:
    *first, last = numbers.tolist()
    return f"{', '.join(map(str, first))} and {last}"


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
