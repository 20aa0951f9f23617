"""Roll-outs of a plan in simulation, from any state, exactly as the planned pianist plays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.metrics.presses import strike_speeds
from sb3_piano.planning.correction import Correction
from sb3_piano.simulation import PianoScene, Simulation
from sb3_piano.threads import ThreadTeam, usable_cores


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
    """Parallel simulations of motions in a scene.

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
            watched: Whether the speeds of keys are measured, which takes a seventh of the time.
        """
        self._scene, self._watched = scene, watched
        self._n_substeps = n_substeps
        self._correction = correction
        threads = usable_cores() if n_threads is None else n_threads
        self._team = ThreadTeam(threads, threads)
        self._simulations = [Simulation(scene, n_substeps) for _ in range(threads)]
        self._joints = scene.hand_qpos
        self._middle = (scene.ctrl_high + scene.ctrl_low) / 2
        self._half_range = (scene.ctrl_high - scene.ctrl_low) / 2

    def start(self) -> FloatArray:
        """Return the initial state of an episode."""
        data = mujoco.MjData(self._scene.model)
        state = np.empty(self._simulations[0].state_size)
        mujoco.mj_getState(self._scene.model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        return state

    def run(self, state: FloatArray, step: int, ways: Sequence[Way]) -> list[RollOut]:
        """Simulate motions from one state, that before control step ``step``."""
        results: list[RollOut | None] = [None] * len(ways)
        n_threads = self._team.n_threads

        def job(thread: int) -> None:
            for row in range(thread, len(ways), n_threads):
                results[row] = self._play(self._simulations[thread], state, step, ways[row])

        self._team.run(job)
        return [result for result in results if result is not None]

    def close(self) -> None:
        """End the threads."""
        self._team.close()

    def _play(self, simulation: Simulation, state: FloatArray, step: int, way: Way) -> RollOut:
        scene, data = self._scene, simulation.data
        told, been = np.empty_like(way.commands), np.empty_like(way.commands)
        angles = np.zeros((len(told), len(scene.key_sounding_angle)))
        speeds = np.zeros_like(angles)
        simulation.set_state(state)
        stable = True
        for i in range(len(told)):
            been[i] = self._positions(data)
            commands = way.commands[i] + self._correction(step + i, been[i] - way.positions[i])
            told[i] = np.minimum(np.maximum(commands, scene.ctrl_low), scene.ctrl_high)
            if not simulation.advance(self._rounded(told[i]), watched=self._watched):
                stable = False
                break
            angles[i] = scene.key_angle(data)
            if self._watched:
                speeds[i] = self._speeds(simulation)
        end = self._positions(data)
        return RollOut(simulation.get_state(), Way(told, been), end, angles, stable, speeds)

    def _speeds(self, simulation: Simulation) -> FloatArray:
        """Compute the speeds of keys that went down in the last control step, (88,) rad/s."""
        steps = [simulation.key_angles_before, *simulation.key_angles]
        angles = self._scene.angles_of(steps)[None]
        within = angles >= self._scene.key_sounding_angle
        speeds = strike_speeds(angles, within[:, 1:])[0] / self._scene.model.opt.timestep
        return np.where(within[0, 0], 0.0, speeds)

    def _positions(self, data: mujoco.MjData) -> FloatArray:
        """Compute actuator positions from joints rounded as in observations, to 32-bit floats."""
        joints = data.qpos[self._joints].astype(np.float32).astype(float)
        return self._correction.positions(joints)

    def _rounded(self, told: FloatArray) -> FloatArray:
        """Round commands as in an action, to 32-bit floats."""
        action = ((told - self._middle) / self._half_range).astype(np.float32).astype(float)
        return np.asarray(self._middle + self._half_range * np.clip(action, -1.0, 1.0))
