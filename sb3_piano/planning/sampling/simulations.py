"""Copies of an environment's simulation, advanced at the same time in threads."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_piano.envs import PianoEnv
from sb3_piano.simulation import PianoScene, Simulation, compile_scene
from sb3_piano.threads import ThreadTeam

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Simulations:
    """n simulations of one environment, which take its state but never touch it.

    Each has its own ``MjData``, so that from step to step it keeps all that the solver starts from,
    and is advanced exactly as the environment is. ``mujoco.rollout`` would lose that between two
    control steps (it hands back positions and velocities only), and is no faster.
    """

    def __init__(self, piano: PianoEnv, physics: str | None, n: int, n_threads: int | None):
        """Build the simulations.

        Args:
            piano: The environment.
            physics: Physics profile to simulate in; None for the environment's own model, with all
                changes made to it.
            n: How many.
            n_threads: Threads to use; by default as many as there are cores, ``n`` at most.

        Raises:
            ConfigError: If there is no such profile, or it does not fit the control step.
        """
        self.source = piano.scene
        """The scene of the environment for which these were built."""
        config = (
            piano.config if physics is None else dataclasses.replace(piano.config, physics=physics)
        )
        self.scene = piano.scene if physics is None else _same_scene(piano, config.physics)
        self._simulations = [Simulation(self.scene, config.n_substeps) for _ in range(n)]
        self._datas = [simulation.data for simulation in self._simulations]
        team = ThreadTeam(n, n_threads)
        # A slot is a thread here: which simulations it advances depends on how many are left.
        self._team = ThreadTeam(team.n_threads, team.n_threads)

    def begin(self, piano: PianoEnv, n: int) -> None:
        """Put the first n simulations into the environment's present state."""
        model, first = self.scene.model, self._datas[0]
        if model is piano.model:
            mujoco.mj_copyData(first, model, piano.data)
        else:
            state = np.empty(mujoco.mj_stateSize(piano.model, _STATE))
            mujoco.mj_getState(piano.model, piano.data, state, _STATE)
            mujoco.mj_resetData(model, first)
            mujoco.mj_setState(model, first, state, _STATE)
            mujoco.mj_step1(model, first)
        for data in self._datas[1:n]:
            mujoco.mj_copyData(data, model, first)

    def advance(self, which: IntArray, controls: FloatArray) -> npt.NDArray[np.bool_]:
        """Simulate a control step.

        Args:
            which: The m simulations to be advanced; the others stay where they are.
            controls: (m, nu) what the actuators of each are told.

        Returns:
            (m,) bool, whether the physics of each remained stable.
        """
        stable = np.zeros(len(which), dtype=bool)
        n_threads = self._team.n_threads

        def job(thread: int) -> None:
            for row in range(thread, len(which), n_threads):
                stable[row] = self._simulations[which[row]].advance(controls[row])

        self._team.run(job)
        return stable

    def key_angles(self, which: IntArray) -> FloatArray:
        """Return the angle of each key, (m, 88) rad."""
        return np.stack([self.scene.key_angle(self._datas[n]) for n in which])

    def positions(self, which: IntArray) -> FloatArray:
        """Return the positions of the actuators, (m, nu) rad or m."""
        return np.stack([self._datas[n].actuator_length for n in which])

    def fingertips(self, which: IntArray) -> FloatArray:
        """Return the positions of the fingertips, (m, 10, 3) m."""
        return np.stack([self.scene.fingertip_position(self._datas[n]) for n in which])

    def press_points(self, which: IntArray, keys: npt.NDArray[np.intp]) -> FloatArray:
        """Return where k keys should be pressed, (m, k, 3) m."""
        return np.stack([self.scene.press_point(self._datas[n], keys) for n in which])


def _same_scene(piano: PianoEnv, physics: str) -> PianoScene:
    moving, config = piano.scene.moving_keys, piano.config
    return compile_scene(
        reduced_action_space=config.reduced_action_space,
        gravity_compensation=config.gravity_compensation,
        physics=physics,
        moving_keys=(moving.start, moving.stop - 1),
    )
