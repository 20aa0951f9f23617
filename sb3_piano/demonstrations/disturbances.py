"""Noise on the actions of a piano, and hands that begin out of place."""

from __future__ import annotations

import math
from typing import Annotated, Any

import gymnasium as gym
import mujoco
import numpy as np
import numpy.typing as npt
from annotated_types import Ge

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import Number, Unit, checked
from sb3_piano.simulation import PianoScene

DEFAULT_MEMORY = 0.2
"""Time in which the noise loses most (1 - 1/e) of its memory, s."""


METRES_PER_RADIAN = 0.05
"""Travel of a forearm, m, that counts as 1 rad of a joint: a twentieth, about what a finger
joint moves its tip."""

FloatArray = npt.NDArray[np.float64]


def disturbance_units(scene: PianoScene) -> FloatArray:
    """Return what a disturbance of 1 rad means for each actuator, (nu,): 1 rad, or 0.05 m."""
    return np.where(_slides(scene), METRES_PER_RADIAN, 1.0)


def disturbance_units_of_joints(scene: PianoScene) -> FloatArray:
    """Return the same for the joints of both hands, (n,), right hand first, sliders last in each.

    The order is that of ``scene.joint_qpos``.
    """
    model = scene.model
    slides = model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)
    slide_qpos = model.jnt_qposadr[slides]
    return np.where(np.isin(np.concatenate(scene.joint_qpos), slide_qpos), METRES_PER_RADIAN, 1.0)


def half_ranges(scene: PianoScene) -> FloatArray:
    """Return by how much an action's change of 1 moves each actuator's target, (nu,) rad or m."""
    return np.asarray((scene.ctrl_high - scene.ctrl_low) / 2)


def _slides(scene: PianoScene) -> npt.NDArray[np.bool_]:
    model = scene.model
    on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    joint = np.where(on_joint, model.actuator_trnid[:, 0], 0)
    return on_joint & (model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_SLIDE))


class ActuatorNoise:
    """Noise that is added to the actions of a piano environment, correlated in time.

    A first-order autoregressive process for each actuator, stationary from the first step on. The
    pedal has none.

    Args:
        env: A piano environment, wrapped or not, whose actions are those of the bare one.
        std: Standard deviation of the actuators' targets, rad, at least 0; for the forearms a
            twentieth of it, in m.
        memory: Time in which the correlation falls to 1/e, s; 0 for noise without memory.

    Raises:
        ConfigError: If a number is out of range, ``env`` is no piano, or its actions are others.
    """

    def __init__(self, env: gym.Env[Any, Any], std: float, memory: float = DEFAULT_MEMORY) -> None:
        std = checked("noise", std, Annotated[Number, Ge(0), Unit("rad")])
        memory = checked("noise_memory", memory, Annotated[Number, Ge(0), Unit("s")])
        piano = env.unwrapped
        if not isinstance(piano, PianoEnv):
            raise ConfigError(
                f"Noise of {std} rad cannot be added in a {type(piano).__name__}: expected a piano "
                "environment, or no noise."
            )
        if env.action_space.shape != piano.action_space.shape:
            raise ConfigError(
                f"Noise of {std} rad cannot be added to actions of shape {env.action_space.shape}: "
                f"expected those of the piano itself, {piano.action_space.shape}, or no noise."
            )
        scene = piano.scene
        self._std = np.append(std * disturbance_units(scene) / half_ranges(scene), 0.0)
        timestep = piano.config.control_timestep
        self._kept = 0.0 if memory == 0 else math.exp(-timestep / memory)
        self._last: npt.NDArray[np.float64] | None = None

    def restart(self) -> None:
        """Begin an episode."""
        self._last = None

    def sample(self, random: np.random.Generator) -> npt.NDArray[np.float64]:
        """Return what to add to the next action."""
        fresh = random.normal(size=self._std.shape) * self._std
        if self._last is None:
            self._last = fresh
        else:
            self._last = self._kept * self._last + math.sqrt(1 - self._kept**2) * fresh
        return self._last


class PerturbedStart(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Begin each episode with the joints of both hands turned at random, within their limits.

    What is drawn comes from the environment's own generator, so that equal seeds begin alike. The
    wrapper goes right around the environment, since the observation is taken anew.

    Args:
        env: A bare piano environment, or what ``gymnasium.make`` returns for one.
        std: Standard deviation of each joint, rad, at least 0; for the forearms a twentieth of it,
            in m.

    Raises:
        ConfigError: If ``std`` is out of range, or ``env`` is no piano or has wrappers that change
            its observation.
    """

    def __init__(self, env: gym.Env[Any, Any], std: float) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, std=std)
        super().__init__(env)
        piano = env.unwrapped
        if not isinstance(piano, PianoEnv):
            raise ConfigError(
                f"The start of a {type(piano).__name__} cannot be perturbed: expected a piano."
            )
        if env.observation_space is not piano.observation_space:
            raise ConfigError(
                "PerturbedStart is around a wrapper that changes the observation: expected it "
                "right around the environment, further in."
            )
        self._piano = piano
        self._std = checked("std", std, Annotated[Number, Ge(0), Unit("rad")])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        _, info = self.env.reset(seed=seed, options=options)
        scene, data = self._piano.scene, self._piano.data
        where = np.concatenate(scene.joint_qpos)
        low, high = np.concatenate(scene.joint_range).T
        offsets = self._piano.np_random.normal(size=len(where)) * self._std
        moved = data.qpos[where] + offsets * disturbance_units_of_joints(scene)
        data.qpos[where] = np.clip(moved, low, high)
        # Putting the state back makes everything that follows from the positions.
        return self._piano.set_state(self._piano.get_state()), info
