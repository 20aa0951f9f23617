"""The least squares of a hand: it only ever gets better, and where it can be checked, is right."""

import numpy as np
import pytest
from hand_parts import arm_of, hand_of, keys_of, scene_of, whole_hand
from scipy.optimize import Bounds, minimize

from sb3_piano.music.fingering.leaps import TimedPress
from sb3_piano.music.presses import Press
from sb3_piano.planning.hand_cost import HandCost
from sb3_piano.planning.least_squares import HandProblem, Smoothness
from sb3_piano.reading.key_frames import key_frames

BOTH_HANDS = pytest.mark.parametrize("hand", [0, 1])
C4, N_STATES = 39, 24


class Parts:
    """A problem with all that its cost consists of."""

    def __init__(self, hand, presses):
        scene = scene_of()
        kinematics, keys = hand_of(scene, hand), keys_of(scene)
        timed = [TimedPress(press, press.first, press.last) for press in presses]
        frames = key_frames(timed, kinematics.sign, N_STATES, kinematics.radius, keys)
        self.kinematics = kinematics
        far = np.full(N_STATES, -10.0 * kinematics.sign)
        self.cost = HandCost(kinematics, arm_of(scene, hand), frames, far)
        self.smoothness = Smoothness(kinematics, np.zeros((2, kinematics.size)), N_STATES)
        self.hand = whole_hand(scene, hand)
        start = np.tile(self.hand.rest, (N_STATES, 1))
        self.problem = HandProblem(self.cost, self.smoothness, self.hand, start)

    def total(self, positions=None):
        positions = self.problem.positions if positions is None else positions
        pulled = self.hand.pull * (positions - self.hand.rest)
        values = self.cost.values(positions)
        return float((values**2).sum() + (pulled**2).sum()) + self.smoothness.cost(positions)


def some_presses(hand):
    key = C4 + 8 if hand == 0 else C4 - 8
    step = 1 if hand == 0 else -1
    return [
        Press(key, 1, 6, 9),
        Press(key + 2 * step, 2, 8, 13),
        Press(key + 7 * step, 4, 14, 20),
        Press(key + 24 * step, 0, 22, 23),
    ]


@BOTH_HANDS
def test_the_cost_never_rises_and_falls_a_lot(hand):
    parts = Parts(hand, some_presses(hand))
    totals = [parts.total()]
    for _ in range(20):
        parts.problem.improve(1)
        totals.append(parts.total())
    assert (np.diff(totals) <= 1e-12 * totals[0]).all()
    assert totals[-1] < 0.1 * totals[0]


@pytest.mark.slow
@BOTH_HANDS
def test_it_comes_to_where_no_small_change_helps(hand):
    parts = Parts(hand, some_presses(hand)[:3])
    parts.problem.improve(100)
    best = parts.problem.positions
    low, high = parts.kinematics.low, parts.kinematics.high
    random = np.random.default_rng(0)
    for scale in (1e-3, 1e-2):
        for _ in range(20):
            way = random.standard_normal(best.shape)
            way = np.cumsum(way, axis=0) if random.random() < 0.5 else way  # jerky and smooth ones
            way /= np.abs(way).max()
            moved = np.clip(best + scale * way, low, high)
            assert parts.total(moved) > parts.total()


@pytest.mark.slow
def test_with_joints_at_their_limits_it_comes_to_what_another_method_does_not_improve():
    wide = [Press(C4 - 8 - 4 * i, i, 6, 16) for i in range(5)]
    parts = Parts(1, wide)
    problem, kinematics = parts.problem, parts.kinematics
    problem.improve(60)
    shape = problem.positions.shape
    low, high = (np.broadcast_to(one, shape).ravel() for one in (kinematics.low, kinematics.high))
    found = problem.positions.ravel()
    assert (np.minimum(found - low, high - found) < 1e-6).any()

    def cost(flat):
        problem.positions = flat.reshape(shape)
        return parts.total(), 2 * problem._normal_equations()[1].ravel()

    reached = parts.total()
    bounds, most = Bounds(low, high), {"maxiter": 200}
    better = minimize(cost, found, jac=True, method="L-BFGS-B", bounds=bounds, options=most)
    assert better.fun > 0.85 * reached
