"""Noise on the actions of a piano, as unsteady as a hand rather than a radio."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.simulation import TIP_TRAVEL

DEFAULT_MEMORY = 0.2
"""Time in which the noise loses most (1 - 1/e) of its memory, s."""


class ActuatorNoise:
    """Noise that is added to the actions of a piano environment, correlated in time.

    A first-order autoregressive process for each actuator, stationary from the first step on. The
    pedal has none.

    Args:
        env: A piano environment, wrapped or not, whose actions are those of the bare one.
        std: Standard deviation of the actuators' targets, rad, at least 0; for the forearms 6 cm
            for each rad.
        memory: Time in which the correlation falls to 1/e, s; 0 for noise without memory.

    Raises:
        ConfigError: If a number is out of range, ``env`` is no piano, or its actions are others.
    """

    def __init__(self, env: gym.Env[Any, Any], std: float, memory: float = DEFAULT_MEMORY) -> None:
        for name, value in (("noise", std), ("noise_memory", memory)):
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(f"{name} is {value}: expected a finite number, at least 0.")
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
        units = np.where(piano.scene.actuator_kind == "forearm", TIP_TRAVEL, 1.0)
        self._std = np.append(piano.action_map.change(std * units), 0.0)
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
