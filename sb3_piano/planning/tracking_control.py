"""Tracking control of a hand along its plan, with inertia and the forces of pressed keys.

The hand's trajectory was planned without inertia. Here the same costs are minimised over its
commands, with linear dynamics as the constraint between states: a linear-quadratic problem for each
Gauss-Newton model of the costs, solved by a backward Riccati pass (iterative LQR; Li and Todorov
2004). The result is a feasible motion, its commands, which anticipate later states, and the optimal
feedback around it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dposv

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.planning.hand_cost import HandCost
from sb3_piano.simulation import PianoScene

# Small weights that keep the problem well posed: of deviations from the first plan, of speeds, and
# of positions outside the control range. Those of the sliders are per metre, not per rad.
_FAITH, _FAITH_ARM = 0.01, 1.0
_SPEED, _SPEED_ARM = 1e-4, 1e-2
_OUTSIDE, _OUTSIDE_ARM = 0.1, 10.0
_EFFORT, _EFFORT_ARM = 1e-4, 1e-2  # of a command that differs from the planned position
_STEPS = (1.0, 0.5, 0.25, 0.1)


@dataclass(frozen=True, eq=False)
class HandDynamics:
    """Linear dynamics of a hand over a control step: ``x' = A x + B u + E w``.

    x are the positions and velocities of the hand's n actuators, u their commands, w generalised
    forces on them.
    """

    transition: FloatArray
    """A, (2 n, 2 n)."""
    control: FloatArray
    """B, (2 n, n)."""
    force: FloatArray
    """E, (2 n, n)."""
    weight: FloatArray
    """(n,) constant force of the hand's weight; 0 if compensated."""

    @classmethod
    def of(
        cls,
        scene: PianoScene,
        kinematics: HandKinematics,
        posture: FloatArray,
        n_substeps: int,
    ) -> HandDynamics:
        """Linearise a hand around a posture.

        The integration is the simulator's: semi-implicit Euler with implicit damping, without joint
        friction and contacts. ``posture`` are (n,) actuator positions; a control step has
        ``n_substeps`` physics steps.
        """
        model = scene.model
        data = mujoco.MjData(model)
        coupling = kinematics.joint_of_actuator
        data.qpos[model.jnt_qposadr[kinematics.joint_ids]] = coupling @ posture
        mujoco.mj_forward(model, data)
        dofs = model.jnt_dofadr[kinematics.joint_ids]
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        inertia = coupling.T @ full[np.ix_(dofs, dofs)] @ coupling
        damping = coupling.T @ (model.dof_damping[dofs, None] * coupling)
        stiffness = np.diag(model.actuator_gainprm[kinematics.actuators, 0])
        transition, force = _discretise(inertia, damping, stiffness, model.opt.timestep, n_substeps)
        weight = coupling.T @ (data.qfrc_gravcomp - data.qfrc_bias)[dofs]
        return cls(transition, force @ stiffness, force, weight)


def _discretise(
    inertia: FloatArray,
    damping: FloatArray,
    stiffness: FloatArray,
    timestep: float,
    n_substeps: int,
) -> tuple[FloatArray, FloatArray]:
    """Compute A and E over some physics steps with constant force."""
    size = len(inertia)
    inverse = np.linalg.inv(inertia + timestep * damping)
    by_velocity = inverse @ inertia
    by_position = -timestep * inverse @ stiffness
    by_force = timestep * inverse
    step = np.block(
        [
            [np.eye(size) + timestep * by_position, timestep * by_velocity],
            [by_position, by_velocity],
        ]
    )
    push = np.concatenate([timestep * by_force, by_force])
    transition, force = np.eye(2 * size), np.zeros((2 * size, size))
    for _ in range(n_substeps):
        force = step @ force + push
        transition = step @ transition
    return transition, force


@dataclass(frozen=True, eq=False)
class HandControl:
    """Motion of a hand over t control steps, with its feedback."""

    states: FloatArray
    """(t, 2 n) positions and velocities after each control step."""
    commands: FloatArray
    """(t, n) commands of the actuators."""
    gains: FloatArray
    """(t, n, n) feedback gains of the commands on positions before the step."""


class TrackingControl:
    """Linear-quadratic tracking problem of one hand over a stretch.

    ``plan`` are (t, n) positions planned without inertia, ``forces`` (t, n) those of held keys,
    ``start`` (2 n,) positions and velocities before the stretch.
    """

    def __init__(
        self,
        cost: HandCost,
        dynamics: HandDynamics,
        plan: FloatArray,
        forces: FloatArray,
        start: FloatArray,
        iterations: int,
    ):
        self._cost, self._dynamics, self._plan, self._start = cost, dynamics, plan, start
        self._drift = (forces + dynamics.weight) @ dynamics.force.T  # (t, 2 n)
        size = plan.shape[1]
        arm = np.isin(cost.kinematics.roles, ("along", "across", "up"))
        self._faith = np.where(arm, _FAITH_ARM, _FAITH)
        self._speed = np.where(arm, _SPEED_ARM, _SPEED)
        self._effort = np.where(arm, _EFFORT_ARM, _EFFORT)
        self._hard = np.where(arm, _OUTSIDE_ARM, _OUTSIDE)
        self._size = size
        self._iterations = iterations

    def solve(self) -> HandControl:
        """Find the best motion by iterative LQR."""
        commands = self._plan.copy()
        states = self._roll_out(commands)
        total = self._total(states, commands)
        for _ in range(max(self._iterations, 1)):
            gains, shifts = self._backward(states, commands)
            more_states, more_commands = self._forward(gains, shifts)
            for share in _STEPS:
                trial_states = states + share * more_states
                trial_commands = commands + share * more_commands
                trial = self._total(trial_states, trial_commands)
                if trial < total:
                    states, commands, total = trial_states, trial_commands, trial
                    break
            else:
                break
        low, high = self._cost.kinematics.low, self._cost.kinematics.high
        return HandControl(states, np.clip(commands, low, high), -gains[:, :, : self._size])

    def _roll_out(self, commands: FloatArray) -> FloatArray:
        transition, control = self._dynamics.transition, self._dynamics.control
        states = np.empty((len(commands), 2 * self._size))
        state = self._start
        for step, command in enumerate(commands):
            state = transition @ state + control @ command + self._drift[step]
            states[step] = state
        return states

    def _total(self, states: FloatArray, commands: FloatArray) -> float:
        positions, velocities = states[:, : self._size], states[:, self._size :]
        return float(
            (self._cost.values(positions) ** 2).sum()
            + (self._faith * (positions - self._plan) ** 2).sum()
            + (self._speed * velocities**2).sum()
            + (self._effort * (commands - self._plan) ** 2).sum()
            + (self._hard * self._outside(commands) ** 2).sum()
            + (self._hard * self._outside(positions) ** 2).sum()
        )

    def _outside(self, commands: FloatArray) -> FloatArray:
        low, high = self._cost.kinematics.low, self._cost.kinematics.high
        return np.asarray(commands - np.clip(commands, low, high))

    def _backward(self, states: FloatArray, commands: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the gains of the commands on the states, (t, n, 2 n), and shifts, (t, n)."""
        size, count = self._size, len(states)
        # (2 n, 3 n) derivatives of the state after a step by the one before and by the commands.
        onwards = np.hstack([self._dynamics.transition, self._dynamics.control])
        blocks, slopes = self._cost.quadratic(states[:, :size])
        slopes += self._faith * (states[:, :size] - self._plan)
        beyond = self._outside(states[:, :size])
        slopes += self._hard * beyond
        held = self._faith + self._hard * (beyond != 0)
        outside = self._outside(commands)
        pull = self._effort * (commands - self._plan) + self._hard * outside
        hardness = self._effort + self._hard * (outside != 0)
        here = np.arange(size)
        gains, shifts = np.empty((count, size, 2 * size)), np.empty((count, size))
        value = np.zeros((2 * size, 2 * size))
        slope = np.zeros(2 * size)
        for step in range(count - 1, -1, -1):
            value[:size, :size] += blocks[step]
            value[here, here] += held[step]
            value[here + size, here + size] += self._speed
            slope[:size] += slopes[step]
            slope[size:] += self._speed * states[step, size:]
            # Quadratic cost-to-go of the state before the step and its commands.
            both = onwards.T @ value @ onwards
            alone = onwards.T @ slope
            across = both[2 * size :, : 2 * size]
            curvature = both[2 * size :, 2 * size :]
            curvature[here, here] += hardness[step]
            wanted = np.empty((size, 2 * size + 1), order="F")
            wanted[:, :-1] = across
            wanted[:, -1] = alone[2 * size :] + pull[step]
            _, solved, failed = dposv(curvature, wanted, overwrite_b=True)
            assert failed == 0, "effort is a cost, so that commands have a curvature"
            gains[step], shifts[step] = -solved[:, :-1], -solved[:, -1]
            slope = alone[: 2 * size] + across.T @ shifts[step]
            value = both[: 2 * size, : 2 * size] + across.T @ gains[step]
            value = (value + value.T) / 2
        return gains, shifts

    def _forward(self, gains: FloatArray, shifts: FloatArray) -> tuple[FloatArray, FloatArray]:
        transition, control = self._dynamics.transition, self._dynamics.control
        more_states = np.empty((len(gains), 2 * self._size))
        more_commands = np.empty_like(shifts)
        state = np.zeros(2 * self._size)
        for step in range(len(gains)):
            more_commands[step] = shifts[step] + gains[step] @ state
            state = transition @ state + control @ more_commands[step]
            more_states[step] = state
        return more_states, more_commands
