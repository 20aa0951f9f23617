"""A hand's motion as a linear system, for control."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_piano.planning.kinematics import HandKinematics
from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HandDynamics:
    """``x' = A x + B u + E w`` over a control step.

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
    """(n,) the constant force of the hand's weight; 0 where it is compensated."""

    @classmethod
    def of(
        cls,
        scene: PianoScene,
        kinematics: HandKinematics,
        posture: FloatArray,
        n_substeps: int,
    ) -> HandDynamics:
        """Linearise a hand around a posture.

        The simulator's step is repeated as it is: semi-implicit Euler with implicit damping.
        Friction of joints and all contacts are left out.

        Args:
            scene: The scene that the hand is in.
            kinematics: The hand.
            posture: (n,) actuator positions.
            n_substeps: Physics steps in a control step.
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
    """Return A and E over some physics steps during which the force is constant."""
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
