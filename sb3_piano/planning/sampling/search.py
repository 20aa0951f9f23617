"""Search of one control step: simulate and rate candidates, and choose the best one."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.envs import PianoEnv
from sb3_piano.music import PianoRoll
from sb3_piano.planning.sampling.cost import SamplingCost, wrong_keys
from sb3_piano.planning.sampling.noise import Candidates
from sb3_piano.planning.tracker import Tracker
from sb3_piano.simulation import compile_scene
from sb3_piano.simulation.simulations import Simulations


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
        simulations.begin(piano.simulation.get_state(), len(knots))
        left = np.arange(len(knots))
        for ahead in range(min(changes.shape[1], len(self._roll) - now)):
            if len(left) == 0:
                break
            step, change = now + ahead, changes[left, ahead]
            controls = np.clip(self._nominal(step, left) + change, scene.ctrl_low, scene.ctrl_high)
            if ahead == 0:
                first = controls
            stable = simulations.advance(left, controls).stable
            angles = scene.key_angle(simulations)[left]
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
        return self._tracker.controls(step, self._positions(which))

    def _hands_cost(self, step: int, which: IntArray) -> FloatArray:
        """Compute the cost of the hands' positions after a control step in m simulations, (m,)."""
        if self._tracker is None:
            return self._finger_cost(step, which)
        planned = np.asarray(self._tracker.plan.positions[step + 1])
        return self._cost.plan_cost(planned, self._positions(which), self._candidates.deviation)

    def _positions(self, which: IntArray) -> FloatArray:
        """Return the actuator positions in m simulations, (m, nu) rad or m."""
        assert self._tracker is not None, "there is a plan"
        joints = self._simulations.qpos[which][:, self._simulations.scene.hand_qpos]
        return self._tracker.positions(joints)

    def _finger_cost(self, step: int, which: IntArray) -> FloatArray:
        keys, fingers = self._roll.due(step)
        if not self._any_finger:
            keys, fingers = keys[fingers >= 0], fingers[fingers >= 0]
        if len(keys) == 0:
            return np.zeros(len(which))
        simulations, scene = self._simulations, self._simulations.scene
        tips = scene.fingertip_position(simulations)[which]
        points = scene.press_point(simulations, keys)[which]
        if self._any_finger:
            return self._cost.any_finger_cost(tips, points)
        return self._cost.finger_cost(tips[:, fingers], points)


def simulations_of(
    piano: PianoEnv, physics: str | None, count: int, n_threads: int | None
) -> Simulations:
    """Build simulations that continue from an environment's states, which they never change.

    Args:
        piano: The environment.
        physics: Physics profile to simulate in; None for the environment's own model, with all
            changes made to it.
        count: Number of simulations.
        n_threads: Threads to use; by default the number of cores.

    Raises:
        ConfigError: If the profile is unknown, or does not fit the control step.
    """
    config, scene = piano.config, piano.scene
    if physics is not None:
        config = dataclasses.replace(config, physics=physics)
        scene = compile_scene(**{**scene.options, "physics": physics})
    return Simulations(scene, config.n_substeps, count, n_threads)
