"""Trajectory of one hand through a stretch: a sparse nonlinear least-squares problem.

The unknowns are the positions of the hand's actuators in all states. Each state's residuals depend
on that state alone, and smoothness couples a state to the two before it. The normal equations are
therefore banded; LAPACK's banded Cholesky factorisation (through SciPy) solves them in time and
memory linear in the length of the stretch. Alternatives: general sparse solvers analyse a structure
that is known here; differential inverse kinematics (such as mink) solves one posture after the
other, so motions begin late; Crocoddyl's shooting methods are not needed, as the hands' dynamics
are nearly linear (:mod:`sb3_piano.planning.tracking_control`).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.planning.hand import Hand
from sb3_piano.planning.hand_cost import HandCost

_LONGEST_STEP = 0.4  # rad, or m
_FIRST_DAMPING = 1e-2
_LEAST_DAMPING, _MOST_DAMPING = 1e-7, 30.0
_FIXING = 1e12  # damping of fixed positions
_AT_END = 1e-9  # within this a position is at an end of its range; rad, or m
_SHARES = (1.0, 0.5, 0.25)  # of a step that are tried

_VELOCITY = 0.002  # weight of a velocity, per rad or m and control step
_JERK_FINGER = 0.02  # weight of a change of a velocity, per rad or m and squared control step
_JERK = {"wrist": 0.04, "along": 0.24, "across": 0.4}  # the same by role
_JERK |= dict.fromkeys(("up", "roll", "pitch", "yaw"), 10.0)


class HandProblem:
    """Levenberg-Marquardt solver with a separate damping for every state.

    A step that is too long in one bar is not shortened in the others. Fingers return to the hand's
    resting posture. ``start`` are the (s, n) initial actuator positions.
    """

    def __init__(
        self,
        cost: HandCost,
        smoothness: Smoothness,
        hand: Hand,
        start: FloatArray,
    ):
        self.cost = cost
        self.positions = start
        """(s, n) best positions so far."""
        self._smoothness = smoothness
        self._rest = hand.rest
        self._pull = hand.pull**2
        self._damping = np.full(len(start), _FIRST_DAMPING)
        self._normal: tuple[FloatArray, FloatArray] | None = None
        self._state_cost: FloatArray
        self._total: float
        self._evaluate()

    def rebound(self, bound: FloatArray) -> None:
        """Move the bound of the arm, (s,) m."""
        self.cost.bound = bound
        self._normal = None
        self._evaluate()

    def improve(self, iterations: int) -> None:
        """Run some iterations."""
        for _ in range(iterations):
            step = self._step()
            if step is None:
                self._damping *= 10
                continue
            better = False
            for share in _SHARES:
                better, worse = self._try(share * step)
                if better:
                    break
            # Damp states that became worse, with their neighbours, as smoothness couples them.
            near = np.convolve(worse, np.ones(5))[2:-2] > 0
            factor = np.where(near, 2.0, 1 / 3) if better else np.where(near, 12.0, 2.0)
            self._damping = np.clip(self._damping * factor, _LEAST_DAMPING, _MOST_DAMPING)

    def _try(self, step: FloatArray) -> tuple[bool, BoolArray]:
        """Take a step if it improves the cost; return this, and which states became worse."""
        kinematics = self.cost.kinematics
        candidate = np.clip(self.positions + step, kinematics.low, kinematics.high)
        by_state = self._by_state(candidate)
        total = float(by_state.sum()) + self._smoothness.cost(candidate)
        worse = by_state > self._state_cost * 1.0001 + 1e-9
        better = total < self._total
        if better:
            self.positions, self._normal = candidate, None
            self._state_cost, self._total = by_state, total
        return better, worse

    def _step(self) -> FloatArray | None:
        if self._normal is None:
            self._normal = self._normal_equations()
        band, gradient = self._normal
        size = self.positions.shape[1]
        damped = band.copy()
        damped[0] += np.repeat(self._damping, size)
        damped[0, self._stopped(gradient).ravel()] += _FIXING
        try:
            factor = cholesky_banded(damped, lower=True, overwrite_ab=True, check_finite=False)
        except LinAlgError:
            return None
        step = cho_solve_banded((factor, True), -gradient.ravel(), check_finite=False)
        return np.clip(step.reshape(self.positions.shape), -_LONGEST_STEP, _LONGEST_STEP)

    def _stopped(self, gradient: FloatArray) -> BoolArray:
        """Find positions at an end of their range that would move beyond it, (s, n).

        If they were free, the step would rely on motion that clipping removes (projected Newton;
        Bertsekas 1982).
        """
        kinematics = self.cost.kinematics
        below = (self.positions <= kinematics.low + _AT_END) & (gradient > 0)
        return below | ((self.positions >= kinematics.high - _AT_END) & (gradient < 0))

    def _normal_equations(self) -> tuple[FloatArray, FloatArray]:
        blocks, gradient = self.cost.quadratic(self.positions)
        size = self.positions.shape[1]
        diagonal = np.arange(size)
        blocks[:, diagonal, diagonal] += self._pull
        band = self._smoothness.band.copy()
        for row, column in zip(*np.tril_indices(size), strict=True):
            band[row - column, column::size] += blocks[:, row, column]
        gradient += self._pull * (self.positions - self._rest)
        gradient += self._smoothness.gradient(self.positions)
        return band, gradient

    def _by_state(self, positions: FloatArray) -> FloatArray:
        pulled = (self._pull * (positions - self._rest) ** 2).sum(axis=1)
        return np.asarray((self.cost.values(positions) ** 2).sum(axis=1) + pulled)

    def _evaluate(self) -> None:
        self._state_cost = self._by_state(self.positions)
        self._total = float(self._state_cost.sum()) + self._smoothness.cost(self.positions)


class Smoothness:
    """Smoothness cost: weighted squared first and second differences of s states.

    ``before`` are the (2, n) actuator positions in the two states before them.
    """

    def __init__(self, kinematics: HandKinematics, before: FloatArray, n_states: int):
        jerk = [_JERK.get(role, _JERK_FINGER) for role in kinematics.roles]
        self._second = np.array(jerk) ** 2
        self._first = np.full(kinematics.size, _VELOCITY**2)
        self._before = before
        self.band = self._band(n_states, kinematics.size)
        """(2 n + 1, s n) Hessian of half the cost: its lower diagonals in LAPACK's layout."""

    def cost(self, positions: FloatArray) -> float:
        """Compute the cost of (s, n) actuator positions."""
        speed, change = self._differences(positions)
        return float((self._first * speed**2).sum() + (self._second * change**2).sum())

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Compute the gradient of half the cost, (s, n)."""
        speed, change = self._differences(positions)
        result = self._first * speed + self._second * change
        result[:-1] -= self._first * speed[1:] + 2 * self._second * change[1:]
        result[:-2] += self._second * change[2:]
        return np.asarray(result)

    def _differences(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        whole = np.concatenate([self._before, positions])
        speed = np.diff(whole, axis=0)
        return speed[1:], np.diff(speed, axis=0)

    def _band(self, count: int, size: int) -> FloatArray:
        here, one_on, two_on = (np.zeros((count, size)) for _ in range(3))
        here += self._first + self._second
        here[:-1] += self._first + 4 * self._second
        here[:-2] += self._second
        one_on[:-1] -= self._first + 2 * self._second
        one_on[:-2] -= 2 * self._second
        two_on[:-2] += self._second
        band = np.zeros((2 * size + 1, count * size))
        band[0], band[size], band[2 * size] = here.ravel(), one_on.ravel(), two_on.ravel()
        return band
