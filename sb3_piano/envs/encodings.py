"""Encodings of goal and state as observations: RoboPianist's full roll, or smaller ones.

An encoding lays out the observation once, prepares itself for each score, and then writes one
vector a control step.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import Arrays, BoolArray, Float32Array, IntArray
from sb3_piano.envs.observation import (
    ALL_KEYS,
    KeyWindow,
    ObservationBlock,
    ObservationLayout,
    used_keys,
)
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import KEY_IS_BLACK, MIN_PITCH, NUM_FINGERS, NUM_KEYS
from sb3_piano.simulation import PianoScene, Simulation
from sb3_piano.simulation.scene import kind_of

GOAL_WIDTH = NUM_KEYS + 1
"""Numbers in one row of the goal: the keys, then the pedal."""

# Joint limits are soft: a joint that is pushed may overshoot its range by a little. The declared
# bounds leave this much room (rad, or m for the sliders).
_JOINT_OVERSHOOT = 1.0

# Decimetres, so that the last centimetre counts among numbers of the order of 1.
_DM_PER_M = 10.0
# The farthest that a fingertip can be from a key, in dm.
_FARTHEST = 20.0
_MOST_WRONG_KEYS = 10


class Encoding(ABC):
    """Writes observations of one layout."""

    layout: ObservationLayout
    """Layout of the observation."""

    @abstractmethod
    def tables(self) -> Arrays:
        """Return what is known of the piece before it is played, a row for each control step."""

    @abstractmethod
    def prepare(self, roll: PianoRoll) -> None:
        """Take a piece, which is then played.

        Raises:
            ScoreError: If this encoding cannot show it; the former piece then remains.
        """

    @abstractmethod
    def write(self, step: int, simulation: Simulation, pedal: float) -> Float32Array:
        """Return the observation before a control step of the piece.

        Args:
            step: Control step that is to be played next, 0 to ``len(roll) - 1``.
            simulation: What is played, as it was read.
            pedal: The pedal's command in [0, 1].
        """


class RollEncoding(Encoding):
    """RoboPianist's observation, for all keys or for a window of them."""

    def __init__(self, scene: PianoScene, n_steps_lookahead: int, window: KeyWindow = ALL_KEYS):
        """Lay out the observation of a window of keys, now and so many control steps later."""
        self._window = window
        self.rows_shown = n_steps_lookahead + 1
        self.layout, _ = window.restrict(_roll_layout(scene, n_steps_lookahead))
        self.keys, self._width = window.slice, len(window) + 1
        self._pedal_at = self.layout["sustain"].start
        # What comes first leaves room for the pedal, a number that is not in qpos.
        self._pedal_and_joints = np.concatenate([[0], *scene.joint_qpos])
        self._labels = scene.fingers

    def prepare(self, roll: PianoRoll) -> None:
        """Take a piece; see :meth:`Encoding.prepare`."""
        self._window.check_keys(used_keys(roll))
        steps = len(roll)
        # Silence is appended, so that the lookahead of the last step can be cut like any other.
        rows = np.zeros((steps + self.rows_shown - 1, self._width), dtype=np.float32)
        rows[:steps, :-1] = roll.active[:, self.keys]
        rows[:steps, -1] = roll.sustain
        self._goal = rows.reshape(-1)
        self._fingers = roll.labelled_fingers()[:, self._labels].astype(np.float32)

    def tables(self) -> Arrays:
        """Return goals, with those of the lookahead after the last step; and fingers."""
        return {"goal": self._goal.reshape(-1, self._width), "fingers": self._fingers}

    def write(self, step: int, simulation: Simulation, pedal: float) -> Float32Array:
        """Return the observation; see :meth:`Encoding.write`."""
        width = self._width
        blocks = (
            self._goal[step * width : (step + self.rows_shown) * width],
            self._fingers[step],
            simulation.key_state[self.keys],
            simulation.qpos[self._pedal_and_joints],
        )
        observation = np.concatenate(blocks, dtype=np.float32)
        observation[self._pedal_at] = pedal
        return observation


class FingerEncoding(Encoding):
    """For each finger, where and when it must press next: a tenth of RoboPianist's numbers."""

    def __init__(self, scene: PianoScene, n_steps_lookahead: int, control_timestep: float):
        """Lay out the observation of fingers that see so many control steps ahead."""
        self._scene = scene
        self._horizon = n_steps_lookahead + 1
        self._control_timestep = control_timestep
        self.layout = _finger_layout(scene, self._horizon * control_timestep)
        self._targets, self._pedal_goal, self._sustain, self._wrong_keys = (
            self.layout[name].slice for name in ("targets", "pedal_goal", "sustain", "wrong_keys")
        )
        self._joint_qpos = np.concatenate(scene.joint_qpos)
        self._joints = slice(self.layout.size - len(self._joint_qpos), self.layout.size)

    def prepare(self, roll: PianoRoll) -> None:
        """Take a piece; see :meth:`Encoding.prepare`."""
        goals = FingerGoals.of(roll, self._horizon)
        fingers = self._scene.fingers
        goal_key = goals.key[:, fingers]
        has_target = goal_key >= 0
        self._not_due = [int.from_bytes((~due).tobytes()) for due in roll.active]
        self._key = key = np.where(has_target, goal_key, 0)
        self._key_geom, self._press_offset = self._scene.press_geometry(key)
        self._has_target, self._scale = has_target, _DM_PER_M * has_target[:, :, None]
        targets = np.zeros((*key.shape, 8))
        targets[:, :, 4] = has_target
        targets[:, :, 5] = goals.onset[:, fingers] * self._control_timestep
        targets[:, :, 6] = goals.release[:, fingers] * self._control_timestep
        targets[:, :, 7] = has_target & KEY_IS_BLACK[key]
        # Everything that does not depend on the simulation.
        self._known = np.zeros((len(roll), self.layout.size), dtype=np.float32)
        self._known[:, self._targets] = targets.reshape(len(roll), -1)
        change = _steps_to_change(roll.sustain, self._horizon) * self._control_timestep
        self._known[:, self._pedal_goal] = np.stack([roll.sustain, change], axis=1)

    def tables(self) -> Arrays:
        """Return each finger's target, and the numbers that depend on nothing else."""
        return {
            "key": self._key,
            "key_geom": self._key_geom,
            "press_offset": self._press_offset,
            "has_target": self._has_target,
            "scale": self._scale,
            "known": self._known,
        }

    def write(self, step: int, simulation: Simulation, pedal: float) -> Float32Array:
        """Return the observation; see :meth:`Encoding.write`."""
        points = simulation.geom_xpos.take(self._key_geom[step], axis=0) + self._press_offset[step]
        depths = simulation.key_state[self._key[step]] * self._has_target[step]
        wrong = (int.from_bytes(simulation.sounding) & self._not_due[step]).bit_count()
        observation: Float32Array = self._known[step].copy()
        targets = observation[self._targets].reshape(-1, 8)  # a view
        tips = simulation.fingertips.take(self._scene.fingers, axis=0)
        targets[:, :3] = (points - tips) * self._scale[step]
        targets[:, 3] = depths
        observation[self._sustain] = pedal
        observation[self._wrong_keys] = min(wrong, _MOST_WRONG_KEYS)
        observation[self._joints] = simulation.qpos[self._joint_qpos]
        return observation


def _roll_layout(scene: PianoScene, n_steps_lookahead: int) -> ObservationLayout:
    """Return RoboPianist's observation order for a scene."""
    fingering = ObservationBlock(
        name="fingering",
        shape=(len(scene.fingers),),
        meaning="1 for each finger that is labelled to press now, thumb to little, the right hand "
        "first",
        binary=True,
    )
    return ObservationLayout(
        [
            ObservationBlock(
                name="goal",
                shape=(n_steps_lookahead + 1, GOAL_WIDTH),
                meaning="1 where a key (columns 0-87) or the pedal (column 88) should be down, for "
                "the current control step and those after it; 0 beyond the end",
                binary=True,
            ),
            *([fingering] if scene.sides else []),
            ObservationBlock(
                name="key_state",
                shape=(NUM_KEYS,),
                meaning="key angle over its largest angle, in [0, 1]",
            ),
            _pedal_block(),
            *_joint_blocks(scene),
        ]
    )


def _finger_layout(scene: PianoScene, horizon: float) -> ObservationLayout:
    target_low = [-_FARTHEST] * 3 + [0.0] * 5
    target_high = [_FARTHEST] * 3 + [1.0, 1.0, horizon, horizon, 1.0]
    return ObservationLayout(
        [
            ObservationBlock(
                name="targets",
                shape=(len(scene.fingers), 8),
                unit="dm (3), 1, 1, s (2), 1",
                meaning="for each finger, thumb to little, the right hand first: the vector from "
                "its tip to the point where it must press next (x towards the player, y to the "
                "right, z up); that key's angle over its largest angle; 1 if there is such a key; "
                "time until it must be down; time until it must be up again; 1 if it is black. "
                "Without a key in sight the times are those of the horizon and all else is 0",
                low=target_low,
                high=target_high,
            ),
            ObservationBlock(
                name="pedal_goal",
                shape=(2,),
                unit="1, s",
                meaning="1 if the pedal should be down; time until that changes, at most the "
                "horizon",
                high=[1.0, horizon],
            ),
            _pedal_block(),
            ObservationBlock(
                name="wrong_keys",
                shape=(1,),
                meaning="how many keys sound that should not, at most 10",
                high=float(_MOST_WRONG_KEYS),
            ),
            *_joint_blocks(scene),
        ]
    )


def _pedal_block() -> ObservationBlock:
    meaning = "the pedal's command in [0, 1]; down from 0.5 on"
    return ObservationBlock(name="sustain", shape=(1,), meaning=meaning)


def _joint_blocks(scene: PianoScene) -> list[ObservationBlock]:
    dofs = scene.options["forearm_dofs"]
    unit, forearm = "m for the last two", "the sliders along the keyboard and towards the hinges"
    forearm += " of the keys"
    if dofs != scene.hand.forearm_dofs():
        sliders = [name for name in dofs if kind_of(scene.hand.role(name)) == "forearm"]
        unit, forearm = f"m for {', '.join(sliders)}", ", ".join(dofs)
    return [
        ObservationBlock(
            name=f"{side}_joints",
            shape=(len(limits),),
            unit=f"rad, {unit}",
            meaning=f"{side} hand's joint positions, wrist to thumb, then {forearm}",
            low=limits[:, 0] - _JOINT_OVERSHOOT,
            high=limits[:, 1] + _JOINT_OVERSHOOT,
        )
        for side, limits in zip(scene.sides, scene.joint_range, strict=True)
    ]


def _steps_to_change(values: BoolArray, most: int) -> IntArray:
    """Return the number of steps that each value lasts from its step on, (T,), at most ``most``."""
    changes = np.flatnonzero(np.diff(values)) + 1
    following = np.searchsorted(changes, np.arange(len(values)), side="right")
    at = np.append(changes, len(values) + most)[following]
    return np.minimum(at - np.arange(len(values)), most)


@dataclass(frozen=True, eq=False, kw_only=True)
class FingerGoals:
    """For each of T control steps and ten fingers the note that it holds, or else its next one."""

    key: IntArray
    """(T, 10) key to press, -1 where the finger has nothing more to play within the horizon."""
    onset: IntArray
    """(T, 10) control steps until the key must be down, 0 while it must; at most the horizon."""
    release: IntArray
    """(T, 10) control steps until it must be up again; at most the horizon."""

    @classmethod
    def of(cls, roll: PianoRoll, horizon: int) -> FingerGoals:
        """Look up to ``horizon`` control steps ahead in a piece.

        Where labels give one finger several keys at once, it is shown the lowest.

        Raises:
            ScoreError: If a note has no finger label.
        """
        check_labels(roll, "fingers")
        steps = len(roll)
        held = _held_keys(roll)
        # A key struck anew is silent for a step before; at the last step every note ends.
        ends = (held >= 0) & (np.diff(held, axis=0, append=-2) != 0)
        key, onset = np.full_like(held, -1), np.full_like(held, horizon)
        release = np.full_like(held, horizon)
        # Steps to the next onset and to the release after it, carried from the end to the start;
        # at first beyond any horizon.
        next_key = np.full(NUM_FINGERS, -1, dtype=np.intp)
        until_onset = np.full(NUM_FINGERS, horizon + 1, dtype=np.intp)
        until_release = until_onset.copy()
        for step in range(steps - 1, -1, -1):
            until_onset, until_release = until_onset + 1, until_release + 1
            holding = held[step] >= 0
            until_release[ends[step]] = 1
            until_onset[holding] = 0
            next_key[holding] = held[step, holding]
            seen = until_onset <= horizon
            key[step, seen] = next_key[seen]
            onset[step, seen] = until_onset[seen]
            release[step, seen] = np.minimum(until_release[seen], horizon)
        return cls(key=key, onset=onset, release=release)


def _held_keys(roll: PianoRoll) -> IntArray:
    """Return the key that each finger holds, (T, 10), -1 where it holds none."""
    held = np.full((len(roll), NUM_FINGERS), -1, dtype=np.intp)
    steps, keys = np.nonzero(roll.active & (roll.finger >= 0))
    # From the highest key to the lowest, so that the lowest remains.
    order = np.argsort(-keys, kind="stable")
    steps, keys = steps[order], keys[order]
    held[steps, roll.finger[steps, keys]] = keys
    return held


def check_labels(roll: PianoRoll, observation: str) -> None:
    """Refuse a roll with a note that has no finger, for an observation that asks for fingers.

    Raises:
        ScoreError: If there is such a note.
    """
    unlabelled = np.argwhere(roll.unlabelled)
    if len(unlabelled) > 0:
        step, key = unlabelled[0]
        raise ScoreError(
            f"The note of pitch {key + MIN_PITCH} at control step {step} has no finger label: "
            f"the observation {observation!r} expects one for every note. Let fingers be found "
            "with fingering='ergonomic' or 'robot'; or, where they are and a hand has more keys to "
            "strike at once than fingers, choose the observation 'roll' or 'window'."
        )
