"""The observation of hands that have read the piece: each sees itself as a right hand."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import Arrays, BoolArray, Float32Array, FloatArray, IntArray
from sb3_piano.envs.encodings import Encoding, check_labels
from sb3_piano.envs.observation import ObservationBlock, ObservationLayout
from sb3_piano.exceptions import PlanWarning
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import KEY_IS_BLACK, MIN_PITCH, NUM_KEYS
from sb3_piano.music.pitch import pitch_name
from sb3_piano.reading import KeyPlaces, Reading, both_hands, read_piece
from sb3_piano.reading.piece import HandReading, bounds_of
from sb3_piano.reading.presses import TimedPress
from sb3_piano.simulation import PianoScene, Simulation
from sb3_piano.simulation.scene import SIDES

FRAMES_AHEAD = np.array([1, 2, 3, 4, 6, 8])
"""States after the present one whose key frames are shown."""

PLACES_AHEAD = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32])
"""States after the present one of which is shown where the arm is wanted."""

BUSY_AHEAD = np.array([1, 6, 16])
"""States after the present one of which is shown whether the hand plays about then."""

LINE_AHEAD = np.array([1, 4, 8, 16])
"""States after the present one of which is shown how far the arm may go."""

PRESSES_AHEAD = 2
"""Presses of each finger that are shown: the one under way or else the next, and that after it."""

MOST_TIME = 2.0
"""The farthest that presses are seen ahead and back, s."""

CLIP = 10.0
"""Networks let standardised observations end here: one strange number must not drown the others."""

_DM_PER_M = 10.0  # so that the last centimetre counts among numbers of the order of 1
_CM_PER_M = 100.0
_FARTHEST = 20.0  # dm
_FULL_WEIGHT = 10.0  # of a key frame across the keys, per m
_FASTEST = 50.0  # rad/s, or m/s
_OVERSHOOT = 1.0  # joint limits are soft; rad or m
_AROUND = np.array([-1, 0, 1])  # keys around a finger that are shown
_MARGIN = 1  # keys added beyond both ends of the keyboard, so that each key has neighbours
_GRID = 1e-3  # of the table of keys by place, m
_NAMED = 5  # notes in a warning


class HandEncoding(Encoding):
    """What each hand read in the piece, relative to its arm and its fingers."""

    def __init__(self, scene: PianoScene, control_timestep: float):
        """Lay out the observation."""
        self.hands = both_hands(scene)
        self._sides = [SIDES.index(name) for name in scene.sides]
        self.places = KeyPlaces.of(scene)
        self._control_timestep = control_timestep
        self.layout = _layout(scene)
        self._fingers, count = len(scene.hand.fingers), len(self._sides)
        self._size = self.layout.size // count
        blocks = list(self.layout.values())[: len(self.layout) // count]
        self.at = {block.name.partition("_")[2]: block.slice for block in blocks}
        self.qpos = np.stack(scene.joint_qpos)
        self.dofs = np.stack([scene.model.jnt_dofadr[joints] for joints in scene.joints])
        self.tip_geoms = scene.fingertip_geom
        self.tip_along = np.concatenate([self.hands[i].tip_along for i in self._sides])[:, None]
        # The left hand in a mirror: y changes its sign, and so does the slider along it.
        self.sign = np.array([1.0, -1.0])[self._sides, None]  # (h, 1)
        self.mirror = np.array([[[1.0, 1.0, 1.0]], [[1.0, -1.0, 1.0]]])[self._sides]
        shown = self.hands[self._sides[0]]  # a hand that is not there may have other joints
        slider = int(np.argmax(shown.joint_of_actuator[:, shown.along]))
        self.joint_sign = np.ones(self.qpos.shape)
        self.joint_sign[:, slider] = self.sign[:, 0]
        self.slider = slider
        self.slope = float(shown.arm_slope[shown.along])
        self.nearest, self.lowest = _keys_by_place(self.places.y)
        self.black = np.pad(KEY_IS_BLACK.astype(np.float32), _MARGIN)
        self._state = np.zeros(NUM_KEYS + 2 * _MARGIN)

    def prepare(self, roll: PianoRoll) -> None:
        """Take a piece; see :meth:`Encoding.prepare`.

        A :class:`~sb3_piano.exceptions.PlanWarning` names the notes that have no finger, as hands
        have too few: nobody plays them.
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
        """Take a piece of which no hand plays the notes without finger; return what was read."""
        read = read_piece(roll, self.hands, self.places)
        bounds = bounds_of(read.line, self.hands[0].spec.forearm.apart)
        steps = len(roll)
        hands = [read.hands[side] for side in self._sides]
        presses = [_FingerPresses.of(hand, read.roll) for hand in hands]
        known = np.zeros((steps, len(hands), self._size), dtype=np.float32)
        target, scale = [], []
        for i, (side, hand, press) in enumerate(zip(self._sides, hands, presses, strict=True)):
            self._write_known(known[:, i], hand, press, bounds[side], self.sign.item(i))
            shown = _states(steps, FRAMES_AHEAD)
            points = np.concatenate([hand.frames.target[shown], press.point], axis=1)
            target.append(points * self.mirror[i] * _DM_PER_M)
            asked = [hand.frames.weight[shown, :, 1] > 0, press.there]
            scale.append(np.concatenate(asked, axis=1)[..., None])
        self._known = known
        self._target = np.stack(target, axis=1)  # (T, h, frames and presses, 5, 3) dm, mirrored
        self._scale = np.stack(scale, axis=1).astype(float)
        self._press_key = np.stack([press.key for press in presses], axis=1)
        self._press_there = np.stack([press.there for press in presses], axis=1)
        self._due = np.pad(roll.active, ((0, 0), (_MARGIN, _MARGIN))).astype(np.float32)
        return read

    def tables(self) -> Arrays:
        """Return what was read, and which keys are due, with one more at both ends."""
        return {
            "known": self._known,
            "target": self._target,
            "scale": self._scale,
            "press_key": self._press_key,
            "press_there": self._press_there,
            "due": self._due,
        }

    def write(self, step: int, simulation: Simulation, pedal: float) -> Float32Array:
        """Return the observation; see :meth:`Encoding.write`."""
        del pedal  # which nothing but the score moves
        data, at, key_state = simulation.data, self.at, simulation.key_state
        rows: Float32Array = self._known[step].copy()
        joints = simulation.qpos[self.qpos] * self.joint_sign
        velocities = data.qvel[self.dofs] * self.joint_sign
        # (h, 1): the middle of a hand whose slider is at 0 is as far out on both sides.
        arm = (self.hands[0].middle + self.slope * joints[:, self.slider])[:, None]
        axes = data.geom_xmat.take(self.tip_geoms, axis=0)[:, 2::3]
        tips = simulation.geom_xpos.take(self.tip_geoms, axis=0) + axes * self.tip_along
        tips = tips.reshape(-1, self._fingers, 3) * self.mirror
        here = tips * _DM_PER_M
        rows[:, at["positions"]] = joints
        rows[:, at["velocities"]] = np.minimum(np.maximum(velocities, -_FASTEST), _FASTEST)
        ways = (self._target[step] - here[:, None]) * self._scale[step]
        frames, presses = rows[:, at["frames"]], rows[:, at["presses"]]
        hands, count = len(rows), len(FRAMES_AHEAD)
        frames.reshape(hands, count, self._fingers, -1)[..., :3] = ways[:, :count]
        presses = presses.reshape(hands, PRESSES_AHEAD, self._fingers, -1)
        presses[..., :3] = ways[:, count:]
        presses[..., 3] = key_state[self._press_key[step]] * self._press_there[step]
        self._write_keys(rows[:, at["keys"]], step, tips[:, :, 1], key_state)
        from_arm = arm * _DM_PER_M
        here[:, :, 1] -= from_arm
        rows[:, at["fingertips"]] = here.reshape(hands, -1)
        rows[:, at["places"]] -= from_arm
        rows[:, at["line"]] -= from_arm
        other = from_arm[::-1] if hands > 1 else self.hands[0].middle * _DM_PER_M
        rows[:, at["other_arm"]] = from_arm + other
        return rows.reshape(-1)

    def _write_keys(
        self, rows: Float32Array, step: int, places: FloatArray, key_state: FloatArray
    ) -> None:
        """Write what the keys around each finger do, and whether they should."""
        across = places * self.sign  # (h, 5) in the world
        cells = ((across - self.lowest) * (1 / _GRID)).astype(np.intp)
        key = self.nearest.take(cells, mode="clip")
        around = key[:, :, None] + (_AROUND * self.sign.astype(np.intp))[:, None] + _MARGIN
        self._state[_MARGIN:-_MARGIN] = key_state
        shown = rows.reshape(len(rows), self._fingers, -1)
        shown[..., 0:3] = self._state[around]
        shown[..., 3:6] = self._due[step][around]
        shown[..., 6:9] = self.black[around]
        shown[..., 9] = _CM_PER_M * (self.places.y[key] - across) * self.sign

    def _write_known(
        self,
        known: Float32Array,
        hand: HandReading,
        presses: _FingerPresses,
        bound: FloatArray,
        sign: float,
    ) -> None:
        """Write what does not depend on the simulation."""
        at, steps = self.at, len(known)
        frames = np.zeros((steps, len(FRAMES_AHEAD), self._fingers, 4))
        weight = hand.frames.weight[_states(steps, FRAMES_AHEAD), :, 1]
        frames[..., 3] = weight / _FULL_WEIGHT
        known[:, at["frames"]] = frames.reshape(steps, -1)
        times = np.stack([presses.first, presses.last], axis=-1) * self._control_timestep
        facts = np.zeros((steps, PRESSES_AHEAD, self._fingers, _PRESS_NUMBERS))
        facts[..., 4:6] = np.clip(times, -MOST_TIME, MOST_TIME) * presses.there[..., None]
        facts[..., 6:11] = presses.facts
        now = (np.arange(steps) * self._control_timestep)[:, None, None, None]
        written = np.clip(presses.written - now, -MOST_TIME, MOST_TIME)
        facts[..., 11:] = written * presses.there[..., None]
        known[:, at["presses"]] = facts.reshape(steps, -1)
        scale = _DM_PER_M * sign
        known[:, at["places"]] = scale * hand.place[_states(steps, PLACES_AHEAD)]
        known[:, at["busy"]] = hand.busy[_states(steps, BUSY_AHEAD)]
        known[:, at["line"]] = scale * bound[_states(steps, LINE_AHEAD)]


_PRESS_NUMBERS = 13  # that an observation has of each press: see _hand_blocks
_TABLE_WIDTH = 13  # of what _FingerPresses is made of, in other columns: see _table


@dataclass(frozen=True, eq=False, kw_only=True)
class _FingerPresses:
    """In each of T states, each finger's press under way or else the next, and that after it."""

    key: IntArray
    """(T, 2, f) its key; 0 if there is none."""
    there: BoolArray
    """(T, 2, f) whether there is one."""
    first: FloatArray
    """(T, 2, f) states until the key must be down; negative where it has been."""
    last: FloatArray
    """(T, 2, f) states until the last one in which it must be down."""
    point: FloatArray
    """(T, 2, f, 3) where the fingertip is when the key is down, m."""
    facts: FloatArray
    """(T, 2, f, 5) 1 if there is one, if it is black, if the hand came by a leap, if it leaves by
    one, if the same finger strikes the key again at once."""
    written: FloatArray
    """(T, 2, f, 2) when its note begins and when it ends as it is written, s from the start."""

    @classmethod
    def of(cls, hand: HandReading, roll: PianoRoll) -> _FingerPresses:
        """Look up what each finger does in each state."""
        steps, fingers = len(roll), hand.frames.target.shape[1]
        onsets = {(step, key): time for step, key, time in roll.strikes()}
        shown = np.zeros((steps, PRESSES_AHEAD, fingers, _TABLE_WIDTH))
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
                shown[there, ahead, finger, 1:3] -= states[there, None]
        return cls(
            key=shown[..., 0].astype(np.intp),
            there=shown[..., 6] > 0,
            first=shown[..., 1],
            last=shown[..., 2],
            point=shown[..., 3:6],
            facts=shown[..., 6:11],
            written=shown[..., 11:],
        )


def _table(
    presses: list[TimedPress],
    hand: HandReading,
    onsets: dict[tuple[int, int], float],
    control_timestep: float,
) -> FloatArray:
    """Return a row for each press of a finger: key, states, point, facts, times as written."""
    table = np.zeros((len(presses), _TABLE_WIDTH))
    for row, one in zip(table, presses, strict=True):
        key, finger = one.press.key, one.press.finger
        start = one.press.first - 1  # the control step that leads to the first state
        onset = onsets.get((start, key), start * control_timestep)
        row[:3] = key, one.first, one.last
        row[3:6] = hand.frames.target[min(one.first, len(hand.place) - 1), finger]
        row[6:11] = True, KEY_IS_BLACK[key], one.leapt, one.leaps, one.repeated
        row[11:] = onset, one.press.last * control_timestep
    return table


def _states(steps: int, ahead: IntArray) -> IntArray:
    """Return for each of T states those that are shown, (T, n); after the last one it is that."""
    return np.minimum(np.arange(steps)[:, None] + ahead, steps)


def _keys_by_place(places: FloatArray) -> tuple[IntArray, float]:
    """Return the nearest key for each millimetre across the keyboard, and where that begins, m."""
    cells = np.arange(places[0], places[-1], _GRID) + _GRID / 2
    return np.abs(cells[:, None] - places).argmin(axis=1), float(places[0])


def _layout(scene: PianoScene) -> ObservationLayout:
    """Return the blocks of each hand, the right one's before the left one's."""
    blocks = [block for side in scene.sides for block in _hand_blocks(scene, side)]
    return ObservationLayout(blocks)


def _hand_blocks(scene: PianoScene, side: str) -> list[ObservationBlock]:
    low, high = scene.joint_range[0].T  # in the mirror they are the left hand's, too
    count, fingers = len(low), len(scene.hand.fingers)
    frames = (len(FRAMES_AHEAD), fingers, 4)
    presses = (PRESSES_AHEAD, fingers, _PRESS_NUMBERS)
    far = [_FARTHEST] * 3
    minus = [-_FARTHEST] * 3
    return [
        ObservationBlock(
            name=f"{side}_positions",
            shape=(count,),
            unit="rad, m for the last two",
            meaning=f"{side} hand's joint positions, wrist to thumb, then the sliders along the "
            "keyboard and towards the hinges of the keys",
            low=low - _OVERSHOOT,
            high=high + _OVERSHOOT,
        ),
        ObservationBlock(
            name=f"{side}_velocities",
            shape=(count,),
            unit="rad/s, m/s for the last two",
            meaning=f"how fast they change, cut at {_FASTEST:g}",
            low=-_FASTEST,
            high=_FASTEST,
        ),
        ObservationBlock(
            name=f"{side}_fingertips",
            shape=(fingers, 3),
            unit="dm",
            meaning="centres of the fingertips, thumb to little finger: x towards the player, y "
            "away from the arm to the little finger's side, z up",
            low=-_FARTHEST,
            high=_FARTHEST,
        ),
        ObservationBlock(
            name=f"{side}_frames",
            shape=frames,
            unit="dm (3), 1",
            meaning=f"for the states after {_listed(FRAMES_AHEAD)} control steps and each finger: "
            "the way from where its tip is now to where it is wanted, and how much that counts; 0 "
            "where it may be anywhere",
            low=[*minus, 0.0],
            high=[*far, 10.0],
        ),
        ObservationBlock(
            name=f"{side}_presses",
            shape=presses,
            unit="dm (3), 1, s (2), 1 (5), s (2)",
            meaning="for each finger's press under way or else the next, then the one after it: "
            "the way to where its tip is when the key is down; the key's angle over its largest "
            "angle; times until it is planned to be down first and last, less than 0 for those "
            f"that are over, cut at {MOST_TIME:g}; 1 if there is such a press, if the key is "
            "black, if the hand comes by a leap, if it leaves by one, if the finger strikes the "
            "key anew at once; times until the note begins and ends as it is written, from which "
            "leaps take a part",
            low=[*minus, 0.0, -MOST_TIME, -MOST_TIME, *[0.0] * 5, -MOST_TIME, -MOST_TIME],
            high=[*far, 1.0, MOST_TIME, MOST_TIME, *[1.0] * 5, MOST_TIME, MOST_TIME],
        ),
        ObservationBlock(
            name=f"{side}_keys",
            shape=(fingers, 10),
            unit="1 (9), cm",
            meaning="for the key that is nearest to each fingertip, and its neighbours on the "
            "thumb's and on the little finger's side (in the order neighbour, key, neighbour): "
            "angles over their largest angles; 1 for those that should sound; 1 for black ones; "
            "then how far the key is to the little finger's side",
            low=[*[0.0] * 9, -200.0],
            high=[*[1.0] * 9, 200.0],
        ),
        ObservationBlock(
            name=f"{side}_places",
            shape=(len(PLACES_AHEAD),),
            unit="dm",
            meaning=f"how far the hand is wanted to the little finger's side of where its arm is, "
            f"in the states after {_listed(PLACES_AHEAD)} control steps",
            low=-_FARTHEST,
            high=_FARTHEST,
        ),
        ObservationBlock(
            name=f"{side}_busy",
            shape=(len(BUSY_AHEAD),),
            meaning=f"1 if the hand plays at about {_listed(BUSY_AHEAD)} control steps from now",
            binary=True,
        ),
        ObservationBlock(
            name=f"{side}_line",
            shape=(len(LINE_AHEAD),),
            unit="dm",
            meaning="how far to the little finger's side the arm has to stay, from where it is, "
            f"in the states after {_listed(LINE_AHEAD)} control steps",
            low=-_FARTHEST,
            high=_FARTHEST,
        ),
        ObservationBlock(
            name=f"{side}_other_arm",
            shape=(1,),
            unit="dm",
            meaning="how far the right arm is to the right of the left one",
            low=-_FARTHEST,
            high=_FARTHEST,
        ),
    ]


def _listed(numbers: IntArray) -> str:
    *first, last = numbers.tolist()
    return f"{', '.join(map(str, first))} and {last}"
