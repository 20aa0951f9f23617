"""The linear dynamics of a hand, against MuJoCo without contacts, dry friction and limits."""

import functools

import mujoco
import numpy as np
import pytest
from hand_parts import data_at, hand_of, joints_by_name, rest_of, scene_of

from sb3_piano.planning.tracking_control import HandDynamics

CONTROL_TIMESTEP = 0.05
CASES = pytest.mark.parametrize(
    ("hand", "options"),
    [
        (0, {}),
        (1, {}),
        (0, {"full": False}),
        (1, {"physics": "fast"}),
        (0, {"gravity_compensation": False}),
    ],
    ids=lambda value: str(value),
)


@functools.cache
def frictionless(scene):
    """Return the scene without all that the linear model leaves out."""
    copied = scene.copy()
    disabled = mujoco.mjtDisableBit
    copied.model.opt.disableflags |= int(disabled.mjDSBL_CONTACT | disabled.mjDSBL_LIMIT)
    copied.model.dof_frictionloss[:] = 0
    return copied


class Stepping:
    """A hand in MuJoCo whose finger joints J1 and J2 are made to bend alike.

    In the real simulation dry friction decides how they share their actuator's way. Here, before
    each physics step, the torques between them are sought that leave them at one speed: the step
    is repeated with one torque after the other, and what it changes is linear in them.
    """

    def __init__(self, scene, hand):
        self.scene = frictionless(scene)
        self.model = self.scene.model
        self.kinematics = hand_of(scene, hand)
        self.by_actuator = joints_by_name(scene, hand)
        self.rest = rest_of(scene, hand)
        self.start = data_at(self.scene, *(rest_of(scene, one) for one in (0, 1)))
        self.data, self.trial = mujoco.MjData(self.model), mujoco.MjData(self.model)
        side = f"{'rl'[hand]}h"
        coupled = [name[:-2] for name in self.kinematics.names if name.endswith("J0")]
        self.apart = np.zeros((len(coupled), self.model.nv))
        for row, finger in enumerate(coupled):
            for end, sign in (("J1", 1), ("J2", -1)):
                joint = self.model.joint(f"{side}_shadow_hand/{side}_{finger}{end}")
                self.apart[row, joint.dofadr[0]] = sign

    def control_step(self, position, velocity, command, force):
        """Return positions and velocities of the actuators a control step later, (2 n,).

        Args:
            position: Of the hand's actuators, (n,) rad or m.
            velocity: Of the same.
            command: What they are told.
            force: Generalised forces on them.
        """
        data = self.data
        mujoco.mj_resetData(self.model, data)
        data.qpos[:] = self.start.qpos + self.by_actuator @ (position - self.rest)
        data.qvel[:] = self.by_actuator @ velocity
        data.ctrl[:] = self.start.actuator_length
        data.ctrl[self.kinematics.actuators] = command
        lengths = self.by_actuator.T @ self.by_actuator
        on_joints = self.by_actuator @ np.linalg.solve(lengths, force)
        for _ in range(round(CONTROL_TIMESTEP / self.model.opt.timestep)):
            data.qfrc_applied[:] = on_joints + self._holding_together(data, on_joints)
            mujoco.mj_step(self.model, data)
        mujoco.mj_forward(self.model, data)
        assert data.nefc == 0, "nothing is left that is not in the linear model"
        ours = self.kinematics.actuators
        return np.concatenate([data.actuator_length[ours], data.actuator_velocity[ours]])

    def _holding_together(self, data, on_joints):
        def drift(torque):
            trial = self.trial
            trial.qpos[:], trial.qvel[:], trial.ctrl[:] = data.qpos, data.qvel, data.ctrl
            trial.qfrc_applied[:] = on_joints + torque
            mujoco.mj_step(self.model, trial)
            return self.apart @ trial.qvel

        nothing = drift(np.zeros(self.model.nv))
        unit = np.stack([drift(row) - nothing for row in self.apart], axis=1)
        return self.apart.T @ np.linalg.solve(unit, -nothing)


@functools.cache
def stepping(hand, full=True, **options):
    return Stepping(scene_of(full=full, **options), hand)


def dynamics_of(real):
    n_substeps = round(CONTROL_TIMESTEP / real.model.opt.timestep)
    return HandDynamics.of(real.scene, real.kinematics, real.rest, n_substeps)


@CASES
def test_small_motions_are_mujocos(hand, options):
    real = stepping(hand, **options)
    model, size = dynamics_of(real), real.kinematics.size
    # How weight changes with posture is not in the linear model.
    tolerance = 2e-3 if options.get("gravity_compensation", True) else 3e-2
    random = np.random.default_rng(0)
    for _ in range(2):
        small = random.uniform(-1, 1, (4, size)) * np.array([1e-4, 1e-3, 1e-4, 1e-4])[:, None]
        ways = []
        for sign in (1, -1):  # what is not linear is the same in both directions
            position, velocity, command, force = sign * small
            ways.append(
                real.control_step(real.rest + position, velocity, real.rest + command, force)
            )
        found = (ways[0] - ways[1]) / 2
        position, velocity, command, force = small
        expected = (
            model.transition @ np.concatenate([position, velocity])
            + model.control @ command
            + model.force @ force
        )
        for part in (slice(None, size), slice(size, None)):  # rad and rad/s
            scale = np.abs(found[part]).max()
            np.testing.assert_allclose(expected[part], found[part], atol=tolerance * scale)


@CASES
def test_the_weight_is_what_moves_a_hand_that_is_told_to_stay(hand, options):
    real = stepping(hand, **options)
    model, size = dynamics_of(real), real.kinematics.size
    nothing = np.zeros(size)
    found = real.control_step(real.rest, nothing, real.rest, nothing)
    found[:size] -= real.rest
    expected = model.force @ model.weight
    balanced = options.get("gravity_compensation", True)
    assert bool(np.abs(found).max() < 1e-9) == balanced
    assert bool(np.abs(expected).max() < 1e-9) == balanced
    np.testing.assert_allclose(expected, found, atol=1e-9 + 0.1 * np.abs(found).max())
