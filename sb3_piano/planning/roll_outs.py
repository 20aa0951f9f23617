"""Roll-outs of a plan in simulation, from any state, exactly as the planned pianist plays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.metrics.presses import strike_speeds
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.planning.correction import Correction
from sb3_piano.simulation import PianoScene, Simulation
from sb3_piano.simulation.simulations import Simulations


class Way(NamedTuple):
    """Motion that a roll-out of s control steps follows, with n actuators, rad or m."""

    commands: FloatArray
    """(s, n) commands at the planned positions, without corrections."""
    positions: FloatArray
    """(s, n) planned positions before each control step."""

    def cut(self, steps: slice) -> Way:
        """Return the part of some control steps."""
        return Way(self.commands[steps], self.positions[steps])


class RollOut(NamedTuple):
    """Result of a simulation over s control steps."""

    state: FloatArray
    """MuJoCo's integration state at the end."""
    way: Way
    """Commands, within the control ranges, and actuator positions before each step."""
    end: FloatArray
    """(n,) actuator positions at the end, rad or m."""
    angles: FloatArray
    """(s, 88) angle of each key after each control step, rad."""
    stable: bool
    """Whether the physics remained stable."""
    speeds: FloatArray
    """(s, 88) speed of each key that begins to sound in a control step, rad/s; 0 for others, and
    unless the roll-outs are ``watched``."""


class RollOuts:
    """Simulations of motions in a scene, side by side.

    All numbers are rounded as between the environment and a player that reads its observations. The
    same commands in an environment give the same motion, to the bit.
    """

    def __init__(
        self,
        scene: PianoScene,
        n_substeps: int,
        correction: Correction,
        n_threads: int | None = None,
        watched: bool = False,
    ):
        """Build the simulations.

        Args:
            scene: The piano and the hands.
            n_substeps: Physics steps of a control step.
            correction: Feedback on deviations from the followed motion.
            n_threads: Threads that simulate, the calling one included; by default one for each
                usable core.
            watched: Whether the speeds of keys are measured.
        """
        self._scene, self._n_substeps, self._watched = scene, n_substeps, watched
        self._correction, self._n_threads = correction, n_threads
        self._simulations = Simulations(scene, n_substeps, 1, n_threads)
        self._middle = (scene.ctrl_high + scene.ctrl_low) / 2
        self._half_range = (scene.ctrl_high - scene.ctrl_low) / 2

    def start(self) -> FloatArray:
        """Return the initial state of an episode."""
        return Simulation(self._scene, self._n_substeps).get_state()

    def run(self, state: FloatArray, step: int, ways: Sequence[Way]) -> list[RollOut]:
        """Simulate motions of equal length from one state, that before control step ``step``."""
        if len(ways) > self._simulations.count:
            parts = (self._scene, self._n_substeps, len(ways), self._n_threads)
            self._simulations = Simulations(*parts)
        scene, simulations, each = self._scene, self._simulations, np.arange(len(ways))
        commands, positions = map(np.stack, zip(*ways, strict=True))
        told, been = np.empty_like(commands), np.empty_like(commands)
        angles = np.zeros((*commands.shape[:2], NUM_KEYS))
        speeds, stable = np.zeros_like(angles), np.ones(len(ways), dtype=bool)
        simulations.begin(state, len(ways))
        for i in range(commands.shape[1]):
            been[:, i] = self._positions(each)
            wanted = commands[:, i] + self._correction(step + i, been[:, i] - positions[:, i])
            told[:, i] = np.minimum(np.maximum(wanted, scene.ctrl_low), scene.ctrl_high)
            before = simulations.qpos[each, scene.key_slice]
            moved = simulations.advance(each, self._rounded(told[:, i]), watched=self._watched)
            stable &= moved.stable
            angles[:, i] = scene.key_angle(simulations)[each]
            if moved.key_angles is not None:
                speeds[:, i] = self._speeds(before, moved.key_angles)
        columns = (simulations.state[each], told, been, self._positions(each), angles)
        return [
            RollOut(end, Way(*way), position, keys, bool(whole), fast)
            for end, *way, position, keys, whole, fast in zip(*columns, stable, speeds, strict=True)
        ]

    def _speeds(self, before: FloatArray, within: FloatArray) -> FloatArray:
        """Compute the speeds of keys that went down in the last control step, (N, 88) rad/s.

        Args:
            before: (N, k) angles of the moving keys before it, rad.
            within: (N, p, k) after each physics step.
        """
        angles = self._scene.of_all_keys(np.concatenate([before[:, None], within], axis=1))
        sounding = angles >= self._scene.key_sounding_angle
        speeds = strike_speeds(angles, sounding[:, 1:]) / self._scene.model.opt.timestep
        return np.where(sounding[:, 0], 0.0, speeds)

    def _positions(self, which: IntArray) -> FloatArray:
        """Compute actuator positions from joints rounded as in observations, to 32-bit floats."""
        joints = self._simulations.qpos[which][:, self._scene.hand_qpos].astype(np.float32)
        return self._correction.positions(joints.astype(float))

    def _rounded(self, told: FloatArray) -> FloatArray:
        """Round commands as in an action, to 32-bit floats."""
        action = ((told - self._middle) / self._half_range).astype(np.float32).astype(float)
        return np.asarray(self._middle + self._half_range * np.clip(action, -1.0, 1.0))
