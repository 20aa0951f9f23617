"""Observation "hands": targets of each hand from the whole piece; the left hand is mirrored."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from sb3_piano.arrays import Arrays, Float32Array, FloatArray, IntArray
from sb3_piano.envs.blocks import Encoding, Now, Parts
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.encodings import DM_PER_M, check_labels, joint_facts
from sb3_piano.envs.observation import ObservationBlock, ObservationLayout, described
from sb3_piano.exceptions import ConfigError, PlanWarning
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import KEY_IS_BLACK, NUM_KEYS, UNKNOWN_FINGER
from sb3_piano.music.dynamics import LOUDEST
from sb3_piano.music.fingering.problems import summary, unheld
from sb3_piano.reading import KeyPlaces, Reading, both_hands, read_piece
from sb3_piano.reading.piece import bounds_of, coming_presses
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import SIDES

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

_AHEAD = {"frames": FRAMES_AHEAD, "places": PLACES_AHEAD, "busy": BUSY_AHEAD, "line": LINE_AHEAD}

CLIP = 10.0
"""Networks clip standardised observations here, so that no outlier dominates the others."""

_CM_PER_M = 100.0
_FULL_WEIGHT = 10.0  # of a key frame across the keys, per m
_AROUND = np.array([-1, 0, 1])  # keys around a finger that are shown
_MARGIN = 1  # keys added beyond both ends of the keyboard, so that each key has neighbours
_GRID = 1e-3  # of the table of keys by place, m


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
        self.slope = shown.slope
        # The nearest key for each millimetre across the keyboard, and the start of the grid, m.
        self.lowest, highest = self.places.y[[0, -1]].tolist()
        cells = np.arange(self.lowest, highest, _GRID) + _GRID / 2
        self.nearest = np.abs(cells[:, None] - self.places.y).argmin(axis=1)
        self.black = np.pad(KEY_IS_BLACK.astype(np.float32), _MARGIN)
        self.around = (_AROUND * self.sign.astype(np.intp))[:, None] + _MARGIN  # (h, 1, 3)
        self._key_state = np.zeros(NUM_KEYS + 2 * _MARGIN)
        blocks = _blocks(scene, config.hands_version)
        of_hand = ObservationLayout(blocks)
        self.at = {name: block.slice for name, block in of_hand.items()}
        """Place of each block among the numbers of a hand."""
        self._shapes = {block.name: block.shape for block in blocks}
        self._size = of_hand.size
        named = [replace(b, name=f"{side}_{b.name}") for side in scene.sides for b in blocks]
        super().__init__(ObservationLayout(named))

    def split(self, numbers: Float32Array) -> Parts:
        """Split observations, (..., n), into a view for each block, with all hands."""
        hands = numbers[..., : self._size * len(self._sides)]
        rows = hands.reshape(*hands.shape[:-1], -1, self._size)
        return {
            name: rows[..., self.at[name]].reshape(*rows.shape[:-1], *shape)
            for name, shape in self._shapes.items()
        }

    def _read(self, roll: PianoRoll) -> None:
        """Set the piece; a ``PlanWarning`` names notes without a finger, which are not played."""
        if not (roll.finger >= 0).any():
            check_labels(roll, "hands")
        problems = [p for p in unheld(self.read(roll).roll) if p.finger == UNKNOWN_FINGER]
        if problems:
            warnings.warn(summary(problems), PlanWarning, stacklevel=2)

    def read(self, roll: PianoRoll) -> Reading:
        """Set the piece without its notes that have no finger; return its reading."""
        read = read_piece(roll, self.hands, self.places)
        bounds = bounds_of(read.line, self.hands[0].spec.forearm.apart)
        hands, steps = [read.hands[side] for side in self._sides], np.arange(len(roll))
        coming = np.stack([coming_presses(one, read.roll, PRESSES_AHEAD) for one in hands], axis=1)
        presses, velocity = coming[..., :13], coming[..., 13]

        def ahead(values: list[Any], states: IntArray) -> FloatArray:
            """Look up hands' values, (T + 1, ...), at n offsets from each state, (T, h, n, ...)."""
            shown = np.minimum(steps[:, None] + states, len(roll))  # the last state repeats
            return np.stack([of_hand[shown] for of_hand in values], axis=1)

        weight = ahead([hand.frames.weight[..., 1] for hand in hands], FRAMES_AHEAD)  # per m
        frames = np.zeros((*weight.shape, 4))
        frames[..., 3] = weight / _FULL_WEIGHT
        there = presses[..., 6, None] > 0
        now = steps[:, None, None, None, None] * self._timestep
        self._press_key, self._there = presses[..., 3].astype(np.intp), there[..., 0]
        planned, written = presses[..., 4:6] * self._timestep, presses[..., 11:] - now
        presses[..., 4:6] = np.clip(planned, -MOST_TIME, MOST_TIME) * there
        presses[..., 11:] = np.clip(written, -MOST_TIME, MOST_TIME) * there
        # Targets of the fingertips: first the key frames', then the presses'.
        target = ahead([hand.frames.target for hand in hands], FRAMES_AHEAD)
        target = np.concatenate([target, presses[..., :3]], axis=2)
        presses[..., :4] = 0.0  # they depend on the state
        self._target = target * self.mirror[:, None] * DM_PER_M  # (T, h, 8, f, 3) dm
        asked = np.concatenate([weight > 0, self._there], axis=2)
        self._scale = asked[..., None].astype(float)
        self._due = np.pad(roll.active, ((0, 0), (_MARGIN, _MARGIN))).astype(np.float32)
        line = ahead([bounds[side] for side in self._sides], LINE_AHEAD)
        places = ahead([hand.place for hand in hands], PLACES_AHEAD)
        known = {"frames": frames, "presses": presses, "places": DM_PER_M * self.sign * places}
        known |= {"loudness": velocity / LOUDEST} if "loudness" in self.at else {}
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

    def _write(self, parts: Parts, now: Now) -> None:
        simulation, data, step = now.simulation, now.simulation.data, now.step
        joints = simulation.qpos[self.qpos] * self.joint_sign
        parts["positions"][:] = joints
        velocities = data.qvel[self.dofs] * self.joint_sign
        parts["velocities"][:] = np.minimum(np.maximum(velocities, -FASTEST), FASTEST)
        # (h, 1) dm to the little finger's side. With the sliders at 0 both hands are equally far
        # from the middle. An absent hand counts as at rest.
        middle = self.hands[0].middle
        arm = (middle + self.slope * joints[:, self.slider])[:, None] * DM_PER_M
        parts["places"][:] -= arm
        parts["line"][:] -= arm
        parts["other_arm"][:] = arm + (middle * DM_PER_M if len(arm) == 1 else arm[::-1])
        axes = data.geom_xmat.take(self.tip_geoms, axis=0)[:, 2::3]
        tips = simulation.geom_xpos.take(self.tip_geoms, axis=0) + axes * self.tip_along
        tips = tips.reshape(-1, self._fingers, 3) * self.mirror  # (h, f, 3) m
        here = tips * DM_PER_M
        # (h, 8, f, 3) dm to the targets in key frames and presses; 0 without a target.
        ways = (self._target[step] - here[:, None]) * self._scale[step]
        here[:, :, 1] -= arm
        parts["fingertips"][:] = here
        parts["frames"][..., :3] = ways[:, : len(FRAMES_AHEAD)]
        parts["presses"][..., :3] = ways[:, len(FRAMES_AHEAD) :]
        depths = simulation.key_state[self._press_key[step]] * self._there[step]
        parts["presses"][..., 3] = depths
        self._write_keys(parts["keys"], step, tips, simulation.key_state)

    def _write_keys(
        self, out: Float32Array, step: int, tips: FloatArray, key_state: FloatArray
    ) -> None:
        across = tips[:, :, 1] * self.sign  # (h, f) in the world
        cells = ((across - self.lowest) * (1 / _GRID)).astype(np.intp)
        key = self.nearest.take(cells, mode="clip")
        around = key[:, :, None] + self.around
        self._key_state[_MARGIN:-_MARGIN] = key_state
        out[..., 0:3] = self._key_state[around]
        out[..., 3:6] = self._due[step][around]
        out[..., 6:9] = self.black[around]
        out[..., 9] = _CM_PER_M * (self.places.y[key] - across) * self.sign


def _blocks(scene: PianoScene, version: int) -> list[ObservationBlock]:
    """Describe the blocks of a hand, also of the mirrored left one."""
    names = ("positions", "velocities", "fingertips", "frames", "presses", "keys", "places", "busy")
    facts: dict[str, Any] = {"late": MOST_TIME, "fastest": FASTEST, "n_presses": PRESSES_AHEAD}
    facts |= {"fingers": len(scene.hand.fingers), **joint_facts(scene, scene.joint_range[0])}
    for name, ahead in _AHEAD.items():
        *first, last = ahead.tolist()
        facts |= {f"n_{name}": len(ahead), name: f"{', '.join(map(str, first))} and {last}"}
    names = (*names, "line", "other_arm", *(("loudness",) if version > 1 else ()))
    return [described(name, facts) for name in names]
