"""Search of one control step: simulate and rate candidates, and choose the best one."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.engine import mujoco
from sb3_piano.envs import PianoEnv
from sb3_piano.music import PianoRoll
from sb3_piano.planning.sampling.cost import SamplingCost, wrong_keys
from sb3_piano.planning.sampling.noise import Candidates
from sb3_piano.planning.tracker import Tracker
from sb3_piano.simulation import Simulation, compile_scene
from sb3_piano.threads import ThreadTeam


class Ratings(NamedTuple):
    """Ratings of n candidates."""

    cost: FloatArray
    """(n,) discounted sum of the cost of all control steps; infinite for candidates that were
    stopped early, or whose physics became unstable."""
    controls: FloatArray
    """(n, nu) controls of the first control step, rad or m."""
    mistakes: IntArray
    """(n,) number of keys that sound wrongly or are missing, over all control steps."""


class CandidateSearch:
    """Simulates and rates changes of nominal controls."""

    def __init__(
        self,
        roll: PianoRoll,
        simulations: Simulations,
        tracker: Tracker | None,
        candidates: Candidates,
        cost: SamplingCost,
    ):
        """Take the parts of the search; without a tracker candidates change hands at rest."""
        self._roll = roll
        self._simulations = simulations
        self._tracker = tracker
        self._candidates = candidates
        self._cost = cost
        scene = simulations.scene
        self._at_rest = np.clip(np.zeros(scene.model.nu), scene.ctrl_low, scene.ctrl_high)
        self._any_finger = not np.count_nonzero(roll.finger >= 0)

    def best(
        self, piano: PianoEnv, known: FloatArray, new: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Find the candidate of least cost; in a tie, the first.

        Known candidates are simulated first. A new one is stopped once it costs more than the best
        of them; as no cost is negative, it could not win any more. With a plan, new candidates are
        skipped if the best known one makes no mistake, because they could not improve the sound.

        Args:
            piano: The environment; the simulations start in its present state.
            known: (m, k, nu) candidates that are likely to be good, at least one.
            new: (n, k, nu) other candidates.

        Returns:
            (k, nu) its change of the nominal controls, as knots, and (nu,) the controls of the
            first control step, rad or m.
        """
        first = self.rate(piano, known)
        leader = int(np.argmin(first.cost))
        faultless = np.isfinite(first.cost[leader]) and first.mistakes[leader] == 0
        if self._tracker is not None and faultless:
            return known[leader], first.controls[leader]
        second = self.rate(piano, new, bound=float(first.cost.min()))
        winner = int(np.argmin(np.concatenate([first.cost, second.cost])))
        controls = np.concatenate([first.controls, second.controls])
        return np.concatenate([known, new])[winner], controls[winner]

    def rate(self, piano: PianoEnv, knots: FloatArray, *, bound: float = np.inf) -> Ratings:
        """Simulate candidates from the present state on, up to the horizon or the piece's end.

        Args:
            piano: The environment; it is not changed.
            knots: (n, k, nu) candidates; n is at most the number of simulations.
            bound: Cost above which a candidate is stopped.
        """
        simulations, scene, now = self._simulations, self._simulations.scene, piano.steps_played
        changes = self._candidates.over_horizon(knots)
        cost, first = np.zeros(len(knots)), np.zeros((len(knots), scene.model.nu))
        mistakes = np.zeros(len(knots), dtype=int)
        simulations.begin(piano, len(knots))
        left = np.arange(len(knots))
        for ahead in range(min(changes.shape[1], len(self._roll) - now)):
            if len(left) == 0:
                break
            step, change = now + ahead, changes[left, ahead]
            controls = np.clip(self._nominal(step, left) + change, scene.ctrl_low, scene.ctrl_high)
            if ahead == 0:
                first = controls
            stable = simulations.advance(left, controls)
            angles = simulations.key_angles(left)
            due, sounding_angle = self._roll.active[step], scene.key_sounding_angle
            mistakes[left] += wrong_keys(due, angles, sounding_angle)
            now_cost = self._cost.key_cost(due, angles, sounding_angle).sum(axis=1)
            now_cost += self._cost.effort_cost(change, self._candidates.deviation)
            now_cost += self._hands_cost(step, left)
            cost[left] += self._cost.discount**ahead * now_cost
            lost = ~stable | (cost[left] > bound)
            cost[left[lost]] = np.inf
            left = left[~lost]
        return Ratings(cost, first, mistakes)

    def _nominal(self, step: int, which: IntArray) -> FloatArray:
        """Return the nominal controls of m simulations, (m, nu) rad or m."""
        if self._tracker is None:
            return np.broadcast_to(self._at_rest, (len(which), len(self._at_rest)))
        joints = self._simulations.joints(which)
        return self._tracker.controls(step, self._tracker.positions(joints))

    def _hands_cost(self, step: int, which: IntArray) -> FloatArray:
        """Compute the cost of the hands' positions after a control step in m simulations, (m,)."""
        if self._tracker is None:
            return self._finger_cost(step, which)
        planned = np.asarray(self._tracker.plan.positions[step + 1])
        positions = self._tracker.positions(self._simulations.joints(which))
        return self._cost.plan_cost(planned, positions, self._candidates.deviation)

    def _finger_cost(self, step: int, which: IntArray) -> FloatArray:
        keys, fingers = self._roll.due(step)
        if not self._any_finger:
            keys, fingers = keys[fingers >= 0], fingers[fingers >= 0]
        if len(keys) == 0:
            return np.zeros(len(which))
        tips = self._simulations.fingertips(which)
        points = self._simulations.press_points(which, keys)
        if self._any_finger:
            return self._cost.any_finger_cost(tips, points)
        return self._cost.finger_cost(tips[:, fingers], points)


class Simulations:
    """n simulations of one environment, which copy its state but never change it.

    Each has its own ``MjData``, so it keeps the solver's warm start from step to step, and advances
    exactly like the environment. ``mujoco.rollout`` would lose the warm start between two control
    steps (it returns positions and velocities only), and is no faster.
    """

    def __init__(self, piano: PianoEnv, physics: str | None, n: int, n_threads: int | None):
        """Build the simulations.

        Args:
            piano: The environment.
            physics: Physics profile to simulate in; None for the environment's own model, with all
                changes made to it.
            n: Number of simulations.
            n_threads: Threads to use; by default the number of cores, but at most ``n``.

        Raises:
            ConfigError: If the profile is unknown, or does not fit the control step.
        """
        self.source = piano.scene
        """Scene of the environment."""
        config, self.scene = piano.config, piano.scene
        if physics is not None:
            config = dataclasses.replace(config, physics=physics)
            self.scene = compile_scene(**{**piano.scene.options, "physics": physics})
        self._simulations = [Simulation(self.scene, config.n_substeps) for _ in range(n)]
        self._datas = [simulation.data for simulation in self._simulations]
        team = ThreadTeam(n, n_threads)
        # One slot per thread; the number of remaining simulations decides which ones it advances.
        self._team = ThreadTeam(team.n_threads, team.n_threads)

    def begin(self, piano: PianoEnv, n: int) -> None:
        """Copy the environment's present state to the first n simulations."""
        model, first = self.scene.model, self._datas[0]
        if model is piano.model:
            mujoco.mj_copyData(first, model, piano.data)
        else:
            self._simulations[0].set_state(piano.simulation.get_state())
        for data in self._datas[1:n]:
            mujoco.mj_copyData(data, model, first)

    def advance(self, which: IntArray, controls: FloatArray) -> BoolArray:
        """Simulate a control step.

        Args:
            which: The m simulations to advance; the others do not change.
            controls: (m, nu) controls of each.

        Returns:
            (m,) bool, whether the physics of each remained stable.
        """
        stable = np.zeros(len(which), dtype=bool)
        n_threads = self._team.n_threads

        def job(thread: int) -> None:
            for row in range(thread, len(which), n_threads):
                stable[row] = self._simulations[which[row]].advance(controls[row], watched=False)

        self._team.run(job)
        return stable

    def key_angles(self, which: IntArray) -> FloatArray:
        """Return the angle of each key, (m, 88) rad."""
        return np.stack([self.scene.key_angle(self._datas[n]) for n in which])

    def joints(self, which: IntArray) -> FloatArray:
        """Return the positions of the hands' joints, (m, j) rad or m."""
        return np.stack([self._datas[n].qpos[self.scene.hand_qpos] for n in which])

    def fingertips(self, which: IntArray) -> FloatArray:
        """Return the positions of the fingertips, (m, 10, 3) m."""
        return np.stack([self.scene.fingertip_position(self._datas[n]) for n in which])

    def press_points(self, which: IntArray, keys: IntArray) -> FloatArray:
        """Return the press points of k keys, (m, k, 3) m."""
        return np.stack([self.scene.press_point(self._datas[n], keys) for n in which])
