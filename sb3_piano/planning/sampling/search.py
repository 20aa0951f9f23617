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
    """How n candidates did."""

    cost: FloatArray
    """(n,) discounted sum of the cost of all control steps; infinite for candidates that were given
    up, or whose physics became unstable."""
    controls: FloatArray
    """(n, nu) what the actuators are told in the first control step, rad or m."""


class Choice(NamedTuple):
    """The best candidate."""

    knots: FloatArray
    """(k, nu) its change of the nominal controls, as knots."""
    controls: FloatArray
    """(nu,) what the actuators are told in the first control step, rad or m."""
    cost: float
    """What it costs."""


class Search:
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
        self._any_finger = not np.count_nonzero(roll.finger >= 0)

    def best(self, piano: PianoEnv, known: FloatArray, new: FloatArray) -> Choice:
        """Return the candidate that costs least; of equals, the first.

        The known ones go first. What the best of them costs is the most that a new one may cost
        before it is given up: no cost is negative, so that none is lost which would have won.

        Args:
            piano: The environment, from whose present state on they are simulated.
            known: (m, k, nu) candidates that are likely to be good, at least one.
            new: (n, k, nu) the others.
        """
        first = self.rate(piano, known)
        second = self.rate(piano, new, bound=float(first.cost.min()))
        cost = np.concatenate([first.cost, second.cost])
        winner = int(np.argmin(cost))
        return Choice(
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
            cost[left] += self._cost.discount**ahead * self.step_cost(step, left, change)
            lost = ~stable | (cost[left] > bound)
            cost[left[lost]] = np.inf
            left = left[~lost]
        return Ratings(cost, first)

    def step_cost(self, step: int, which: IntArray, change: FloatArray) -> FloatArray:
        """Return what the present state of some simulations costs at the end of a control step.

        Args:
            step: The control step.
            which: The m simulations.
            change: (m, nu) how each departed from the nominal controls, rad or m.

        Returns:
            (m,) not discounted.
        """
        simulations, deviation = self._simulations, self._candidates.deviation
        total = costs.key_cost(
            self._cost,
            self._roll.active[step],
            simulations.key_angles(which),
            simulations.scene.key_sounding_angle,
        )
        total += costs.effort_cost(self._cost, change, deviation)
        planned = self._nominal.planned(step)
        if planned is None:
            return total + self._finger_cost(step, which)
        return total + costs.plan_cost(self._cost, planned, simulations.positions(which), deviation)

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
