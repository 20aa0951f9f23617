"""The search of one control step: candidates are simulated, rated, and the best one is taken."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.envs import PianoEnv
from sb3_piano.music import PianoRoll
from sb3_piano.planning.sampling import cost as costs
from sb3_piano.planning.sampling.candidates import Candidates
from sb3_piano.planning.sampling.nominal import Nominal
from sb3_piano.planning.sampling.settings import SamplingCost
from sb3_piano.planning.sampling.simulations import Simulations

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


class Ratings(NamedTuple):
    """Ratings of n candidates."""

    cost: FloatArray
    """(n,) discounted sum of the cost of all control steps; infinite for candidates that were given
    up, or whose physics became unstable."""
    controls: FloatArray
    """(n, nu) what the actuators are told in the first control step, rad or m."""
    mistakes: IntArray
    """(n,) how many keys sound that should not, or do not that should, over all control steps."""


class BestCandidate(NamedTuple):
    """The best candidate."""

    knots: FloatArray
    """(k, nu) its change of the nominal controls, as knots."""
    controls: FloatArray
    """(nu,) what the actuators are told in the first control step, rad or m."""
    cost: float
    """Its cost."""


class CandidateSearch:
    """Simulates changes of a nominal way of playing, and rates what comes of them."""

    def __init__(
        self,
        roll: PianoRoll,
        simulations: Simulations,
        nominal: Nominal,
        candidates: Candidates,
        cost: SamplingCost,
    ):
        """Put the parts together.

        Args:
            roll: What should sound.
            simulations: In which candidates are played.
            nominal: What candidates change.
            candidates: What knots stand for.
            cost: What counts how much.
        """
        self._roll = roll
        self._simulations = simulations
        self._nominal = nominal
        self._candidates = candidates
        self._cost = cost
        self._has_plan = nominal.planned(0) is not None
        self._any_finger = not np.count_nonzero(roll.finger >= 0)

    def best(self, piano: PianoEnv, known: FloatArray, new: FloatArray) -> BestCandidate:
        """Return the candidate that costs least; of equals, the first.

        The known ones go first. What the best of them costs is the most that a new one may cost
        before it is given up: no cost is negative, so that none is lost which would have won. With
        a plan the new ones are left out as long as the best known one makes no mistake: there is
        nothing to be heard that they could do better.

        Args:
            piano: The environment, from whose present state on they are simulated.
            known: (m, k, nu) candidates that are likely to be good, at least one.
            new: (n, k, nu) the others.
        """
        first = self.rate(piano, known)
        leader = int(np.argmin(first.cost))
        faultless = np.isfinite(first.cost[leader]) and first.mistakes[leader] == 0
        if self._has_plan and faultless:
            return BestCandidate(known[leader], first.controls[leader], float(first.cost[leader]))
        second = self.rate(piano, new, bound=float(first.cost.min()))
        cost = np.concatenate([first.cost, second.cost])
        winner = int(np.argmin(cost))
        return BestCandidate(
            knots=np.concatenate([known, new])[winner],
            controls=np.concatenate([first.controls, second.controls])[winner],
            cost=float(cost[winner]),
        )

    def rate(self, piano: PianoEnv, knots: FloatArray, *, bound: float = np.inf) -> Ratings:
        """Simulate candidates from the present state on, up to the horizon or the piece's end.

        Args:
            piano: The environment; it is left as it is.
            knots: (n, k, nu) the candidates; n at most the number of simulations.
            bound: A candidate is given up as soon as it costs more than this.
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
            controls = self._nominal.controls(step, simulations.positions(left)) + change
            controls = np.clip(controls, scene.ctrl_low, scene.ctrl_high)
            if ahead == 0:
                first = controls
            stable = simulations.advance(left, controls)
            angles = simulations.key_angles(left)
            due, sounding_angle = self._roll.active[step], scene.key_sounding_angle
            mistakes[left] += costs.mistakes(due, angles, sounding_angle)
            now_cost = costs.key_cost(self._cost, due, angles, sounding_angle)
            now_cost += costs.effort_cost(self._cost, change, self._candidates.deviation)
            now_cost += self._hands_cost(step, left)
            cost[left] += self._cost.discount**ahead * now_cost
            lost = ~stable | (cost[left] > bound)
            cost[left[lost]] = np.inf
            left = left[~lost]
        return Ratings(cost, first, mistakes)

    def _hands_cost(self, step: int, which: IntArray) -> FloatArray:
        """Return what it costs where the hands of m simulations are after a control step, (m,)."""
        planned = self._nominal.planned(step)
        if planned is None:
            return self._finger_cost(step, which)
        positions = self._simulations.positions(which)
        return costs.plan_cost(self._cost, planned, positions, self._candidates.deviation)

    def _finger_cost(self, step: int, which: IntArray) -> FloatArray:
        keys, fingers = self._roll.due(step)
        if not self._any_finger:
            keys, fingers = keys[fingers >= 0], fingers[fingers >= 0]
        if len(keys) == 0:
            return np.zeros(len(which))
        tips = self._simulations.fingertips(which)
        points = self._simulations.press_points(which, keys)
        if self._any_finger:
            return costs.any_finger_cost(self._cost, tips, points)
        return costs.finger_cost(self._cost, tips[:, fingers], points)
