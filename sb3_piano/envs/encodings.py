"""Encodings of goal and state as observations: RoboPianist's piano roll, or smaller ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from sb3_piano.arrays import Arrays, FloatArray, IntArray
from sb3_piano.envs.blocks import Encoding, Now, Parts
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.observation import (
    ObservationBlock,
    ObservationLayout,
    described,
    restrict_to,
)
from sb3_piano.exceptions import ScoreError
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import KEY_IS_BLACK, MIN_PITCH
from sb3_piano.music.key_window import ALL_KEYS, KeyWindow
from sb3_piano.music.presses import finger_goals, steps_until
from sb3_piano.simulation import PianoScene

DM_PER_M = 10.0
"""Decimetres in a metre. In dm a last centimetre still counts among numbers near 1."""

JOINT_OVERSHOOT = 1.0
"""Margin of the declared bounds beyond the joints' soft limits, rad, or m for sliders."""

MOST_WRONG_KEYS = 10
"""Largest observed number of wrong keys."""


class RollEncoding(Encoding):
    """RoboPianist's observation, for all keys or for a window of them."""

    def __init__(self, scene: PianoScene, config: PianoEnvConfig, window: KeyWindow = ALL_KEYS):
        """Lay out the observation of a window of keys."""
        self._window, self.keys = window, window.slice
        self.rows_shown = config.n_steps_lookahead + 1
        self._fingers = scene.fingers
        self._joints = _joints(scene)
        first = ("goal", "fingering") if scene.sides else ("goal",)
        sizes = {"rows": self.rows_shown, "fingers": len(self._fingers)}
        blocks = [described(name, sizes) for name in (*first, "key_state", "sustain")]
        layout = ObservationLayout([*blocks, *_joint_blocks(scene)])
        super().__init__(restrict_to(window, layout)[0])

    def _read(self, roll: PianoRoll) -> None:
        self._window.check_keys(roll.used_keys)
        # Appended silence lets the lookahead of the last step be sliced like any other.
        self._goal = np.zeros((len(roll) + self.rows_shown - 1, len(self._window) + 1), np.float32)
        self._goal[: len(roll), :-1] = roll.active[:, self.keys]
        self._goal[: len(roll), -1] = roll.sustain
        self._labels = roll.labelled_fingers()[:, self._fingers].astype(np.float32)
        self._use({"fingering": self._labels} if "fingering" in self.layout else {})

    def tables(self) -> Arrays:
        """Return goals, padded by the lookahead after the last step, and fingers."""
        return {"fingers": self._labels, "goal": self._goal}

    def _write(self, parts: Parts, now: Now) -> None:
        parts["goal"][...] = self._goal[now.step : now.step + self.rows_shown]
        parts["key_state"][:] = now.simulation.key_state[self.keys]
        parts["sustain"][0] = now.pedal
        for name, qpos in self._joints:
            parts[name][:] = now.simulation.qpos[qpos]


class FingerEncoding(Encoding):
    """Observation of each finger's next press: a tenth of the size of RoboPianist's."""

    def __init__(self, scene: PianoScene, config: PianoEnvConfig):
        """Lay out the observation."""
        self._scene, self._horizon = scene, config.n_steps_lookahead + 1
        self._timestep = config.control_timestep
        self._joints = _joints(scene)
        sizes = {"fingers": len(scene.fingers), "horizon": self._horizon * self._timestep}
        sizes["most_wrong"] = MOST_WRONG_KEYS
        names = ("targets", "pedal_goal", "sustain", "wrong_keys")
        blocks = [described(name, sizes) for name in names]
        super().__init__(ObservationLayout([*blocks, *_joint_blocks(scene)]))

    def _read(self, roll: PianoRoll) -> None:
        check_labels(roll, "fingers")
        goals = finger_goals(roll, self._horizon)
        goal_key, onset, release = (each[:, self._scene.fingers] for each in goals)
        self._there = there = goal_key >= 0
        self._key = key = np.where(there, goal_key, 0)
        self._geom, self._offset = self._scene.press_geometry(key)
        self._scale = DM_PER_M * there[:, :, None]
        self._not_due = [int.from_bytes((~due).tobytes()) for due in roll.active]
        targets = np.zeros((*key.shape, 8))
        targets[:, :, 4] = there
        targets[:, :, 5:7] = np.stack([onset, release], axis=2) * self._timestep
        targets[:, :, 7] = there & KEY_IS_BLACK[key]
        changes = np.diff(roll.sustain, append=roll.sustain[-1])[:, None]
        until = np.minimum(steps_until(changes, self._horizon) + 1, self._horizon)
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

    def _write(self, parts: Parts, now: Now) -> None:
        step, simulation, targets = now.step, now.simulation, parts["targets"]
        points = simulation.geom_xpos.take(self._geom[step], axis=0) + self._offset[step]
        tips = simulation.fingertips.take(self._scene.fingers, axis=0)
        targets[:, :3] = (points - tips) * self._scale[step]
        targets[:, 3] = simulation.key_state[self._key[step]] * self._there[step]
        wrong = int.from_bytes(simulation.sounding) & self._not_due[step]
        parts["wrong_keys"][0] = min(wrong.bit_count(), MOST_WRONG_KEYS)
        parts["sustain"][0] = now.pedal
        for name, qpos in self._joints:
            parts[name][:] = simulation.qpos[qpos]


def _joints(scene: PianoScene) -> list[tuple[str, IntArray]]:
    """List the hands' blocks of joint positions, and where MuJoCo has these."""
    return [(f"{side}_joints", at) for side, at in zip(scene.sides, scene.joint_qpos, strict=True)]


def _joint_blocks(scene: PianoScene) -> list[ObservationBlock]:
    """Describe a block of joint positions for each hand."""
    return [
        described("joints", {**joint_facts(scene, limits), "side": side}, f"{side}_joints")
        for side, limits in zip(scene.sides, scene.joint_range, strict=True)
    ]


def joint_facts(scene: PianoScene, limits: FloatArray) -> dict[str, Any]:
    """Return what the blocks of a hand's joints say of them, given their (n, 2) soft limits."""
    dofs = scene.options["forearm_dofs"]
    sliders = "the sliders along the keyboard and towards the hinges of the keys"
    return {
        "joints": len(limits),
        "lowest": limits[:, 0] - JOINT_OVERSHOOT,
        "highest": limits[:, 1] + JOINT_OVERSHOOT,
        "forearm": sliders if dofs == scene.hand.forearm_dofs() else ", ".join(dofs),
    }


def check_labels(roll: PianoRoll, observation: str) -> None:
    """Raise a ScoreError unless all notes of a roll have fingers, as an observation requires."""
    unlabelled = np.argwhere(roll.unlabelled)
    if len(unlabelled) > 0:
        step, key = unlabelled[0]
        raise ScoreError(
            f"The note of pitch {key + MIN_PITCH} at control step {step} has no finger label: "
            f"the observation {observation!r} expects one for every note. Set "
            "fingering='ergonomic' or 'robot' to find fingers. If a hand still has more keys to "
            "strike at once than fingers, choose the observation 'roll' or 'window'."
        )
