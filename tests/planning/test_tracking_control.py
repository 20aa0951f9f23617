"""The linear-quadratic problem of a hand, against dense least squares and small changes."""

import numpy as np
import pytest
from hand_parts import arm_of, hand_of, keys_of, rest_of, scene_of, whole_hand

from sb3_piano.music.fingering.leaps import TimedPress
from sb3_piano.music.presses import Press
from sb3_piano.planning import tracking_control
from sb3_piano.planning.hand_cost import HandCost
from sb3_piano.planning.least_squares import HandProblem, Smoothness
from sb3_piano.planning.tracking_control import HandDynamics, TrackingControl
from sb3_piano.reading.key_frames import key_frames

SCENE = scene_of()
KINEMATICS = hand_of(SCENE, 0)
SIZE = KINEMATICS.size
REST = rest_of(SCENE, 0)
DYNAMICS = HandDynamics.of(SCENE, KINEMATICS, REST, 10)
T = 6
N_ITERATIONS = 8


class LinearCost:
    """Residuals that are linear in the positions, as those of fingertips are not."""

    kinematics = KINEMATICS

    def __init__(self, n_states=T, seed=0):
        random = np.random.default_rng(seed)
        self.matrix = random.standard_normal((n_states, 7, SIZE))
        self.goal = self.matrix @ REST + random.uniform(-0.1, 0.1, (n_states, 7))

    def values(self, positions):
        return np.einsum("srn,sn->sr", self.matrix, positions) - self.goal

    def quadratic(self, positions):
        hessian = np.einsum("srn,srm->snm", self.matrix, self.matrix)
        return hessian, np.einsum("srn,sr->sn", self.matrix, self.values(positions))

    def after(self, step):
        """Return the same without the first steps."""
        later = LinearCost()
        later.matrix, later.goal = self.matrix[step:], self.goal[step:]
        return later


def some_plan(seed=1):
    random = np.random.default_rng(seed)
    return np.clip(
        REST + random.uniform(-0.05, 0.05, (T, SIZE)), KINEMATICS.low + 0.1, KINEMATICS.high - 0.1
    )


def some_forces(seed=2):
    return np.random.default_rng(seed).uniform(-0.01, 0.01, (T, SIZE))


def at_rest(moved=0.0):
    return np.concatenate([REST + moved, np.zeros(SIZE)])


def wide_ranges(monkeypatch):
    """Put all commands within the control ranges: what is beyond them is not quadratic."""
    monkeypatch.setattr(KINEMATICS, "low", np.full(SIZE, -1e3))
    monkeypatch.setattr(KINEMATICS, "high", np.full(SIZE, 1e3))


def dense_commands(cost, plan, forces, start):
    """Return the commands, (t, n), that minimise the cost as one linear least-squares problem."""
    count = len(plan)
    a, b, e = DYNAMICS.transition, DYNAMICS.control, DYNAMICS.force
    # All states as a constant and a matrix of all commands.
    constant, matrix = np.empty((count, 2 * SIZE)), np.zeros((count, 2 * SIZE, count * SIZE))
    state, by_command = start, np.zeros((2 * SIZE, count * SIZE))
    for t in range(count):
        state, by_command = a @ state + e @ (forces[t] + DYNAMICS.weight), a @ by_command
        by_command[:, t * SIZE : (t + 1) * SIZE] += b
        constant[t], matrix[t] = state, by_command
    arm = np.array([name.startswith("forearm") for name in KINEMATICS.names])
    faith = np.sqrt(np.where(arm, tracking_control._FAITH_ARM, tracking_control._FAITH))
    speed = np.sqrt(np.where(arm, tracking_control._SPEED_ARM, tracking_control._SPEED))
    effort = np.sqrt(np.where(arm, tracking_control._EFFORT_ARM, tracking_control._EFFORT))
    rows, goals = [], []
    for t in range(count):
        place, velocity = slice(0, SIZE), slice(SIZE, None)
        own = np.zeros((SIZE, count * SIZE))
        own[:, t * SIZE : (t + 1) * SIZE] = np.diag(effort)
        rows += [
            cost.matrix[t] @ matrix[t, place],
            faith[:, None] * matrix[t, place],
            speed[:, None] * matrix[t, velocity],
            own,
        ]
        goals += [
            cost.goal[t] - cost.matrix[t] @ constant[t, place],
            faith * (plan[t] - constant[t, place]),
            -speed * constant[t, velocity],
            effort * plan[t],
        ]
    solved = np.linalg.lstsq(np.concatenate(rows), np.concatenate(goals), rcond=None)[0]
    return solved.reshape(count, SIZE)


def test_for_a_quadratic_cost_it_is_the_dense_solution(monkeypatch):
    wide_ranges(monkeypatch)
    cost, plan, forces = LinearCost(), some_plan(), some_forces()
    found = TrackingControl(cost, DYNAMICS, plan, forces, at_rest(0.02), N_ITERATIONS).solve()
    expected = dense_commands(cost, plan, forces, at_rest(0.02))
    assert np.abs(expected - plan).max() > 0.01, "there is something to be found"
    np.testing.assert_allclose(found.commands, expected, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("step", [0, 1, T - 1])
def test_the_gains_tell_how_the_best_commands_change_with_where_a_hand_is(monkeypatch, step):
    """Solve the rest of the piece again from a place that differs."""
    wide_ranges(monkeypatch)
    cost, plan, forces = LinearCost(), some_plan(), some_forces()
    found = TrackingControl(cost, DYNAMICS, plan, forces, at_rest(), N_ITERATIONS).solve()
    ahead = np.random.default_rng(3).uniform(-0.02, 0.02, SIZE)
    before = at_rest() if step == 0 else found.states[step - 1]
    elsewhere = before + np.concatenate([ahead, np.zeros(SIZE)])
    rest = cost.after(step), plan[step:], forces[step:]
    change = dense_commands(*rest, elsewhere)[0] - dense_commands(*rest, before)[0]
    assert np.abs(change).max() > 0.01
    np.testing.assert_allclose(-found.gains[step] @ ahead, change, atol=1e-6)


# A hand with fingertips, which are not linear.

C4, N_STATES = 39, 20
PRESSES = [Press(C4 + 8, 1, 5, 8), Press(C4 + 10, 2, 9, 13), Press(C4 + 15, 4, 13, 18)]


def real_problem():
    keys = keys_of(SCENE)
    timed = [TimedPress(press, press.first, press.last) for press in PRESSES]
    frames = key_frames(timed, 1, N_STATES + 1, KINEMATICS.radius, keys)
    cost = HandCost(KINEMATICS, arm_of(SCENE, 0), frames.between(1, None), np.full(N_STATES, -10.0))
    smoothness = Smoothness(KINEMATICS, np.tile(REST, (2, 1)), N_STATES)
    start = np.tile(REST, (N_STATES, 1))
    problem = HandProblem(cost, smoothness, whole_hand(SCENE, 0), start)
    problem.improve(25)
    return cost, problem.positions


def solved(iterations=N_ITERATIONS, forces=None):
    cost, plan = real_problem()
    forces = np.zeros_like(plan) if forces is None else forces
    control = TrackingControl(cost, DYNAMICS, plan, forces, at_rest(), iterations)
    return control, control.solve(), cost, plan


@pytest.mark.slow
def test_against_keys_that_push_back_hands_are_told_to_go_farther():
    """What a key does to a finger, the command makes up for: the finger is where it was."""
    bends = KINEMATICS.names.index("FFJ3")
    push = np.zeros((N_STATES, SIZE))
    push[5:15, bends] = -0.05
    _, free, _, _ = solved()
    _, pushed, _, _ = solved(forces=push)
    stiffness = SCENE.model.actuator_gainprm[KINEMATICS.actuators[bends], 0]
    more = (pushed.commands - free.commands)[8:12, bends]
    np.testing.assert_allclose(more, 0.05 / stiffness, rtol=0.3)
    off = np.abs(pushed.states - free.states)[8:12, bends]
    assert (off < 0.3 * 0.05 / stiffness).all()
