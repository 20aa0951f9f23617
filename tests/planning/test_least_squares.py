"""The least squares of a hand: it only ever gets better, and where it can be checked, is right."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hand_parts import SETTINGS, hand_of, keys_of, posture_of, scene_of

from sb3_piano.planning.hand_cost import HandCost
from sb3_piano.planning.key_frames import key_frames
from sb3_piano.planning.leaps import TimedPress
from sb3_piano.planning.least_squares import HandProblem
from sb3_piano.planning.presses import Press
from sb3_piano.planning.smoothness import Smoothness

BOTH_HANDS = pytest.mark.parametrize("hand", [0, 1])
C4, N_STATES = 39, 24
UNCONCERNED = dataclasses.replace(
    SETTINGS, weight_idle=0.0, weight_wall=0.0, weight_spacing=0.0, weight_arms=0.0
)


class Parts:
    """A problem with all that its cost consists of."""

    def __init__(self, hand, presses, options=SETTINGS, full=True, bound=None, rest=True):
        scene = scene_of(full=full)
        kinematics, keys = hand_of(scene, hand), keys_of(scene)
        timed = [TimedPress(press, press.first, press.last) for press in presses]
        sign = kinematics.sign
        frames = key_frames(timed, sign, N_STATES, kinematics.radius, keys, options)
        bound = np.full(N_STATES, -10.0 * sign) if bound is None else bound
        self.kinematics, self.options = kinematics, options
        self.cost = HandCost(kinematics, frames, options, bound)
        self.before = np.zeros((2, kinematics.size))
        self.smoothness = Smoothness(kinematics, options, self.before, N_STATES)
        self.posture = posture_of(scene, hand)
        start = np.tile(self.posture.rest if rest else self.before[0], (N_STATES, 1))
        self.problem = HandProblem(self.cost, self.smoothness, self.posture, options, start)

    def total(self, positions=None):
        positions = self.problem.positions if positions is None else positions
        pulled = self.posture.pull(self.options) * (positions - self.posture.rest)
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


@BOTH_HANDS
def test_steps_are_sought_with_the_slope_and_the_curvature_of_the_whole_cost(hand):
    parts = Parts(hand, some_presses(hand))
    parts.problem.improve(3)
    here = parts.problem.positions
    band, gradient = parts.problem._normal_equations()
    blocks, _ = parts.cost.quadratic(here)
    pull = parts.posture.pull(SETTINGS)
    random = np.random.default_rng(0)
    still = np.zeros_like(here)
    for _ in range(5):
        way = random.standard_normal(here.shape)
        rise = parts.total(here + 1e-6 * way) - parts.total(here - 1e-6 * way)
        assert (gradient * way).sum() == pytest.approx(rise / 4e-6, rel=1e-4, abs=1e-6)
        # The smoothness is quadratic, so that three of its values tell its curvature.
        bent = parts.smoothness.cost(way) + parts.smoothness.cost(-way)
        bent = bent / 2 - parts.smoothness.cost(still)
        expected = np.einsum("sn,snm,sm->", way, blocks, way) + ((pull * way) ** 2).sum() + bent
        flat = way.ravel()
        found = band[0] @ flat**2
        for below in range(1, len(band)):
            found += 2 * (band[below, :-below] * flat[:-below]) @ flat[below:]
        assert found == pytest.approx(expected)


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


def dense_solution(parts):
    """Return where only posture and smoothness lead, one linear problem for each actuator."""
    jerk = {"WRJ1": SETTINGS.jerk_wrist, "WRJ2": SETTINGS.jerk_wrist}
    jerk |= {"forearm_tx": SETTINGS.jerk_along, "forearm_ty": SETTINGS.jerk_inwards}
    whole = np.eye(N_STATES + 2)
    pull = parts.posture.pull(SETTINGS)
    columns = []
    for actuator, name in enumerate(parts.kinematics.names):
        rows = np.concatenate(
            [
                SETTINGS.velocity * np.diff(whole, axis=0)[1:, 2:],
                jerk.get(name, SETTINGS.jerk_finger) * np.diff(whole, n=2, axis=0)[:, 2:],
                pull[actuator] * np.eye(N_STATES),
            ]
        )
        goal = np.zeros(len(rows))
        goal[-N_STATES:] = pull[actuator] * parts.posture.rest[actuator]
        columns.append(np.linalg.lstsq(rows, goal, rcond=None)[0])
    return np.clip(np.stack(columns, axis=1), parts.kinematics.low, parts.kinematics.high)


@pytest.mark.slow
@BOTH_HANDS
@pytest.mark.parametrize("full", [True, False])
def test_without_notes_and_neighbours_it_is_the_dense_solution(hand, full):
    parts = Parts(hand, [], UNCONCERNED, full, rest=False)
    parts.problem.improve(60)
    np.testing.assert_allclose(parts.problem.positions, dense_solution(parts), atol=1e-4)


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True, reason="states whose own cost must rise for a better whole are damped ever more"
)
def test_it_is_the_dense_solution_from_wherever_the_search_begins():
    parts = Parts(0, [], UNCONCERNED, rest=True)
    parts.problem.improve(60)
    np.testing.assert_allclose(parts.problem.positions, dense_solution(parts), atol=1e-3)


@BOTH_HANDS
def test_positions_stay_in_the_control_ranges(hand):
    key = 87 if hand == 0 else 0
    parts = Parts(hand, [Press(key, 0, 5, 10), Press(87 - key, 4, 15, 20)])  # out of reach
    parts.problem.improve(15)
    assert (parts.problem.positions >= parts.kinematics.low).all()
    assert (parts.problem.positions <= parts.kinematics.high).all()


@pytest.mark.slow
@BOTH_HANDS
def test_fingertips_come_to_their_keys(hand):
    parts = Parts(hand, some_presses(hand)[:3])
    parts.problem.improve(40)
    tips = parts.kinematics.fingertips(parts.problem.positions)
    for press in some_presses(hand)[:3]:
        states = slice(press.first, press.last + 1)
        target = parts.cost.frames.target[states, press.finger]
        assert np.abs(tips[states, press.finger] - target)[:, 1:].max() < 0.004


@pytest.mark.slow
@BOTH_HANDS
def test_a_new_bound_moves_the_arm_out_of_the_way(hand):
    parts = Parts(hand, [])
    sign = parts.kinematics.sign
    parts.problem.improve(20)
    before = parts.kinematics.arm(parts.problem.positions)
    bound = before + sign * 0.1
    parts.problem.rebound(bound)
    assert parts.cost.bound_violation(parts.problem.positions).max() == pytest.approx(0.1)
    parts.problem.improve(20)
    late = slice(N_STATES // 2, None)  # it needs some time for that
    assert (sign * (parts.kinematics.arm(parts.problem.positions) - before)[late] > 0.08).all()


def test_what_is_solved_again_is_what_the_new_bound_makes_of_it():
    """Rebounding forgets the costs under the bound before: the search goes on, and downwards."""
    parts = Parts(0, some_presses(0))
    parts.problem.improve(10)
    parts.problem.rebound(parts.kinematics.arm(parts.problem.positions) + 0.05)
    totals = [parts.total()]
    for _ in range(10):
        parts.problem.improve(1)
        totals.append(parts.total())
    assert (np.diff(totals) <= 1e-12 * totals[0]).all()
    assert totals[-1] < totals[0]
