"""Wrappers that disturb a recording: noise on actions, perturbed starts."""

from __future__ import annotations

import copy
import math
from typing import Annotated, Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from annotated_types import Ge

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.settings import Number, Unit, checked
from sb3_piano.simulation.scene import kind_of, tip_unit
from sb3_piano.wrappers import HandActions

DEFAULT_MEMORY = 0.2
"""Time constant of the noise, s: 1/e of its memory remains."""


class CorrelatedNoise:
    """Noise correlated in time.

    A first-order autoregressive process for each number, stationary from the first step on.

    Args:
        std: Standard deviation of each number.
        memory: Time in which the correlation falls to 1/e, s; 0 for noise without memory.
        timestep: Time between two samples, s.
    """

    def __init__(self, std: npt.NDArray[np.float64], memory: float, timestep: float) -> None:
        self._std = std
        self._kept = 0.0 if memory == 0 else math.exp(-timestep / memory)
        self._last: npt.NDArray[np.float64] | None = None

    def restart(self) -> None:
        """Begin an episode."""
        self._last = None

    def sample(self, random: np.random.Generator) -> npt.NDArray[np.float64]:
        """Draw the noise of the next action."""
        fresh = random.normal(size=self._std.shape) * self._std
        if self._last is None:
            self._last = fresh
        else:
            self._last = self._kept * self._last + math.sqrt(1 - self._kept**2) * fresh
        return self._last


class ActuatorNoise(CorrelatedNoise):
    """Noise on the actions of a piano environment, except the pedal's.

    Args:
        env: A piano environment, wrapped or not, whose actions are those of the bare one, or of
            :class:`~sb3_piano.wrappers.HandActions`.
        std: Standard deviation of the actuators' targets, rad, at least 0; for the forearms 6 cm,
            or 0.15 rad, for each rad.
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
        units = np.array([tip_unit(str(kind)) for kind in piano.scene.actuator_kind])
        by_hand = next((one for one in layers(env) if isinstance(one, HandActions)), None)
        if env.action_space.shape == piano.action_space.shape:
            std_of_actions = np.append(piano.action_map.change(std * units), 0.0)
        elif by_hand is not None and env.action_space is by_hand.action_space:
            std_of_actions = std * units / np.abs(by_hand.reach)
        else:
            raise ConfigError(
                f"Noise of {std} rad cannot be added to actions of shape {env.action_space.shape}: "
                f"expected those of the piano itself, {piano.action_space.shape}, or of "
                "sb3_piano.wrappers.HandActions, or no noise."
            )
        super().__init__(std_of_actions, memory, piano.config.control_timestep)


class NoisyActions(gym.Wrapper[Any, Any, Any, Any]):
    """Add noise without memory to every action, as :class:`ActuatorNoise` does.

    Equal seeds give equal noise. A copy of the environment for a search has no noise, as it cannot
    be predicted.

    Args:
        env: A bare piano environment, or what ``gymnasium.make`` returns for one.
        std: Standard deviation of the actuators' targets, rad, as of :class:`ActuatorNoise`.

    Raises:
        ConfigError: If ``std`` is out of range, or ``env`` is no piano or takes other actions.
    """

    def __init__(self, env: gym.Env[Any, Any], std: float) -> None:
        super().__init__(env)
        self._noise = ActuatorNoise(env, std, memory=0.0)
        self._random = np.random.default_rng()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        if seed is not None:  # apart from what players draw by the same seed
            self._random = np.random.default_rng(seed).spawn(1)[0]
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play an action with noise."""
        return self.env.step(action + self._noise.sample(self._random))

    def __deepcopy__(self, memo: dict[int, Any]) -> gym.Env[Any, Any]:
        return copy.deepcopy(self.env, memo)


class PerturbedStart(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Begin each episode with random joint angles of both hands, within their limits.

    Random numbers come from the environment's own generator, so equal seeds begin alike. The
    wrapper must be the innermost, since the observation is taken anew.

    Args:
        env: A bare piano environment, or what ``gymnasium.make`` returns for one.
        std: Standard deviation of each joint, rad, at least 0; for the forearms 6 cm, or
            0.15 rad, for each rad.

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
        where = scene.hand_qpos
        names = [scene.hand.short(name) for names in scene.joint_names for name in names]
        units = [tip_unit(kind_of(scene.hand.role(name))) for name in names]
        low, high = np.concatenate(scene.joint_range).T
        offsets = self._piano.np_random.normal(size=len(where)) * self._std
        moved = data.qpos[where] + offsets * units
        data.qpos[where] = np.clip(moved, low, high)
        # Putting the state back makes everything that follows from the positions.
        return self._piano.set_state(self._piano.get_state()), info
