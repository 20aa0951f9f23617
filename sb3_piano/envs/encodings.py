"""Encodings of goal and state as observations: RoboPianist's piano roll, or smaller ones."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import Arrays, BoolArray, Float32Array, IntArray
from sb3_piano.envs.blocks import Encoding, Now, Write
from sb3_piano.envs.config import PianoEnvConfig
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
from sb3_piano.simulation import PianoScene

DM_PER_M = 10.0
"""Decimetres in a metre. In dm a last centimetre still counts among numbers near 1."""

FARTHEST = 20.0
"""Bound of distances on the keyboard, dm."""

JOINT_OVERSHOOT = 1.0
"""Margin of the declared bounds beyond the joints' soft limits, rad, or m for sliders."""

JOINTS_MEANING = (
    "joint positions, wrist to thumb, then the sliders along the keyboard and towards the hinges "
    "of the keys"
)

MOST_WRONG_KEYS = 10
"""Largest observed number of wrong keys."""

Blocks = list[tuple[ObservationBlock, Write | None]]


class RollEncoding(Encoding):
    """RoboPianist's observation, for all keys or for a window of them."""

    def __init__(self, scene: PianoScene, config: PianoEnvConfig, window: KeyWindow = ALL_KEYS):
        """Lay out the observation of a window of keys."""
        self._window, self.keys = window, window.slice
        self.rows_shown = config.n_steps_lookahead + 1
        self._fingers = scene.fingers
        goal = ObservationBlock(
            name="goal",
            shape=(self.rows_shown, NUM_KEYS + 1),
            binary=True,
            meaning="1 if a key (columns 0-87) or the pedal (column 88) should be down, for the "
            "current and the following control steps; 0 beyond the end",
        )
        fingering = ObservationBlock(
            name="fingering",
            shape=self._fingers.shape,
            binary=True,
            meaning="1 for each finger labelled to press now, thumb to little finger, the right "
            "hand first",
        )
        key_state = ObservationBlock(
            name="key_state",
            shape=(NUM_KEYS,),
            meaning="key angle over its largest angle, in [0, 1]",
        )
        blocks: Blocks = [(goal, self._write_goal)]
        blocks += [(fingering, None)] if scene.sides else []
        blocks += [(key_state, self._write_key_state), (SUSTAIN, _write_sustain), *_joints(scene)]
        layout = ObservationLayout(block for block, _ in blocks)
        super().__init__(blocks, window.restrict(layout)[0])

    def prepare(self, roll: PianoRoll) -> None:
        """Set the piece to play; see :meth:`Encoding.prepare`."""
        self._window.check_keys(used_keys(roll))
        # Appended silence lets the lookahead of the last step be sliced like any other.
        self._goal = np.zeros((len(roll) + self.rows_shown - 1, len(self._window) + 1), np.float32)
        self._goal[: len(roll), :-1] = roll.active[:, self.keys]
        self._goal[: len(roll), -1] = roll.sustain
        self._labels = roll.labelled_fingers()[:, self._fingers].astype(np.float32)
        self._use({"fingering": self._labels})

    def tables(self) -> Arrays:
        """Return goals, padded by the lookahead after the last step, and fingers."""
        return {"fingers": self._labels, "goal": self._goal}

    def _write_goal(self, out: Float32Array, now: Now) -> None:
        out[...] = self._goal[now.step : now.step + self.rows_shown]

    def _write_key_state(self, out: Float32Array, now: Now) -> None:
        out[:] = now.simulation.key_state[self.keys]


class FingerEncoding(Encoding):
    """Observation of each finger's next press: a tenth of the size of RoboPianist's."""

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        """Lay out the observation."""
        self._scene, self._horizon = scene, config.n_steps_lookahead + 1
        self._timestep = config.control_timestep
        longest = self._horizon * self._timestep
        targets = ObservationBlock(
            name="targets",
            shape=(len(scene.fingers), 8),
            unit="dm (3), 1, 1, s (2), 1",
            low=(*[-FARTHEST] * 3, *[0.0] * 5),
            high=(*[FARTHEST] * 3, 1.0, 1.0, longest, longest, 1.0),
            meaning="for each finger, thumb to little finger, the right hand first: the vector "
            "from its tip to the point where it must press next (x towards the player, y to the "
            "right, z up); that key's angle over its largest angle; 1 if it has such a key; time "
            "until the key must be down; time until it must be up again; 1 if it is black. "
            "Without a key within the horizon both times are the horizon and the other numbers "
            "are 0",
        )
        pedal_goal = ObservationBlock(
            name="pedal_goal",
            shape=(2,),
            unit="1, s",
            high=(1.0, longest),
            meaning="1 if the pedal should be down; time until this changes, at most the horizon",
        )
        wrong_keys = ObservationBlock(
            name="wrong_keys",
            high=float(MOST_WRONG_KEYS),
            meaning="number of keys that sound and should not, at most 10",
        )
        blocks: Blocks = [(targets, self._write_targets), (pedal_goal, None)]
        blocks += [(SUSTAIN, _write_sustain), (wrong_keys, self._write_wrong_keys)]
        super().__init__([*blocks, *_joints(scene)])

    def prepare(self, roll: PianoRoll) -> None:
        """Set the piece to play; see :meth:`Encoding.prepare`."""
        goals, fingers = FingerGoals.of(roll, self._horizon), self._scene.fingers
        goal_key = goals.key[:, fingers]
        self._there = there = goal_key >= 0
        self._key = key = np.where(there, goal_key, 0)
        self._geom, self._offset = self._scene.press_geometry(key)
        self._scale = DM_PER_M * there[:, :, None]
        self._not_due = [int.from_bytes((~due).tobytes()) for due in roll.active]
        targets = np.zeros((*key.shape, 8))
        targets[:, :, 4] = there
        targets[:, :, 5] = goals.onset[:, fingers] * self._timestep
        targets[:, :, 6] = goals.release[:, fingers] * self._timestep
        targets[:, :, 7] = there & KEY_IS_BLACK[key]
        changes = np.diff(roll.sustain, append=roll.sustain[-1])[:, None]
        until = np.minimum(_steps_until(changes, self._horizon) + 1, self._horizon)
        pedal = np.concatenate([roll.sustain[:, None], until * self._timestep], axis=1)
        self._use({"targets": targets, "pedal_goal": pedal})

    def tables(self) -> Arrays:
        """Return each finger's target, and the numbers that depend on the piece alone."""
        return {
            "key": self._key,
            "key_geom": self._geom,
            "press_offset": self._offset,
            "has_target": self._there,
            "scale": self._scale,
            "known": self.known_rows(),
        }

    def _write_targets(self, out: Float32Array, now: Now) -> None:
        step, simulation = now.step, now.simulation
        points = simulation.geom_xpos.take(self._geom[step], axis=0) + self._offset[step]
        tips = simulation.fingertips.take(self._scene.fingers, axis=0)
        out[:, :3] = (points - tips) * self._scale[step]
        out[:, 3] = simulation.key_state[self._key[step]] * self._there[step]

    def _write_wrong_keys(self, out: Float32Array, now: Now) -> None:
        wrong = int.from_bytes(now.simulation.sounding) & self._not_due[now.step]
        out[0] = min(wrong.bit_count(), MOST_WRONG_KEYS)


SUSTAIN = ObservationBlock(
    name="sustain", meaning="the pedal's command in [0, 1]; the pedal is down at 0.5 and above"
)
"""Block of the pedal."""


def _write_sustain(out: Float32Array, now: Now) -> None:
    out[0] = now.pedal


def _joints(scene: PianoScene) -> Blocks:
    """Make a block of joint positions for each hand."""
    meaning, dofs = JOINTS_MEANING, scene.options["forearm_dofs"]
    if dofs != scene.hand.forearm_dofs():
        meaning = f"joint positions, wrist to thumb, then {', '.join(dofs)}"
    blocks: Blocks = []
    for side, limits, qpos in zip(scene.sides, scene.joint_range, scene.joint_qpos, strict=True):
        block = ObservationBlock(
            name=f"{side}_joints",
            shape=qpos.shape,
            unit="rad, m of sliders",
            low=limits[:, 0] - JOINT_OVERSHOOT,
            high=limits[:, 1] + JOINT_OVERSHOOT,
            meaning=f"{side} hand's {meaning}",
        )
        blocks.append((block, functools.partial(_write_joints, qpos)))
    return blocks


def _write_joints(qpos: IntArray, out: Float32Array, now: Now) -> None:
    out[:] = now.simulation.qpos[qpos]


class FingerGoals(NamedTuple):
    """Present or next note of each of ten fingers in T control steps."""

    key: IntArray
    """(T, 10) key to press, -1 if the finger has no note within the horizon."""
    onset: IntArray
    """(T, 10) control steps until the key must be down (0: now), at most the horizon."""
    release: IntArray
    """(T, 10) control steps until it must be up again, at most the horizon."""

    @classmethod
    def of(cls, roll: PianoRoll, horizon: int) -> FingerGoals:
        """Find each finger's goals up to ``horizon`` control steps ahead.

        If labels give one finger several keys at once, its goal is the lowest.

        Raises:
            ScoreError: If a note has no finger label.
        """
        check_labels(roll, "fingers")
        held, steps = _held_keys(roll), np.arange(len(roll))[:, None]
        # A repeated key is silent for a step before the strike. Every note ends at the last step.
        ends = (held >= 0) & (np.diff(held, axis=0, append=-2) != 0)
        onset, release = _steps_until(held >= 0, horizon), _steps_until(ends, horizon) + 1
        key = np.take_along_axis(held, np.minimum(steps + onset, len(roll) - 1), axis=0)
        seen = onset <= horizon
        release = np.where(seen, np.minimum(release, horizon), horizon)
        return cls(np.where(seen, key, -1), np.where(seen, onset, horizon), release)


def _steps_until(events: BoolArray, horizon: int) -> IntArray:
    """Count the steps to each column's next event, (T, n); more than the horizon if it has none."""
    steps = np.arange(len(events))[:, None]
    at = np.where(events, steps, len(events) + horizon)
    return np.minimum.accumulate(at[::-1])[::-1] - steps


def _held_keys(roll: PianoRoll) -> IntArray:
    """Return the key that each finger holds, (T, 10), or -1."""
    held = np.full((len(roll), NUM_FINGERS), -1, dtype=np.intp)
    steps, keys = np.nonzero(roll.active & (roll.finger >= 0))
    # From the highest key to the lowest, so that the lowest overwrites the others.
    order = np.argsort(-keys, kind="stable")
    steps, keys = steps[order], keys[order]
    held[steps, roll.finger[steps, keys]] = keys
    return held


def check_labels(roll: PianoRoll, observation: str) -> None:
    """Check that all notes of a roll have fingers, as an observation requires.

    Raises:
        ScoreError: If a note has none.
    """
    unlabelled = np.argwhere(roll.unlabelled)
    if len(unlabelled) > 0:
        step, key = unlabelled[0]
        raise ScoreError(
            f"The note of pitch {key + MIN_PITCH} at control step {step} has no finger label: "
            f"the observation {observation!r} expects one for every note. Set "
            "fingering='ergonomic' or 'robot' to find fingers. If a hand still has more keys to "
            "strike at once than fingers, choose the observation 'roll' or 'window'."
        )
