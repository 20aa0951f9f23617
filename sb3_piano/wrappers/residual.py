"""Residual actions: something plays, and an agent corrects it."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.envs.actions import action_numbers
from sb3_piano.exceptions import InvalidActionError
from sb3_piano.wrappers.hand_actions import CorrectsHandActions


class Residual(gym.Wrapper[Any, Any, Any, Any], CorrectsHandActions):
    """Let something play, and the agent correct it.

    What is played is its action plus ``reach`` times the agent's, cut at -1 and 1. Observations are
    those of the environment. Wrappers inside of this one get what is played, those outside what the
    agent does.

    Source: residual policies (Silver et al. 2018, "Residual Policy Learning"; Johannink et al.
    2019, "Residual Reinforcement Learning for Robot Control").

    Args:
        env: An environment whose actions begin with a number for each actuator; if the pedal's
            follows, the agent has none for it.
        reach: (n,) by how much the agent's actions of 1 change the actuators' numbers.
    """

    def __init__(self, env: gym.Env[Any, Any], reach: FloatArray) -> None:
        super().__init__(env)
        self._reach = reach.astype(np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, reach.shape, dtype=np.float32)
        self._seen: Any = None

    @property
    @abstractmethod
    def standardization(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, (n,), by which an agent may take observations."""

    @abstractmethod
    def base_action(self, observation: Any) -> Float32Array:
        """Return a new array with what is played without a correction."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        self._seen, info = self.env.reset(seed=seed, options=options)
        return self._seen, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step, corrected.

        Raises:
            InvalidActionError: If the action has the wrong shape.
        """
        self._seen, *result = self.env.step(self.corrected(self._seen, action))
        return self._seen, *result

    def snapshot(self) -> Any:
        """Return what goes with ``PianoEnv.snapshot``: the last observation."""
        return self._seen

    def go_back(self, moment: Any) -> None:
        """Go back to a moment."""
        self._seen = moment

    def corrected(self, observation: Any, action: Any) -> Float32Array:
        """Return what is played of an observation with the agent's action.

        Raises:
            InvalidActionError: If the action has the wrong shape.
        """
        # Cut first, as huge numbers are none of float32.
        correction = np.clip(action_numbers(action), -1.0, 1.0).astype(np.float32)
        if correction.shape != self._reach.shape:
            raise InvalidActionError(
                f"The action has shape {correction.shape}: expected {self._reach.shape}, one "
                "number for each actuator and none for the pedal."
            )
        played = self.base_action(observation)
        played[: len(correction)] += self._reach * correction
        return np.minimum(np.maximum(played, -1.0), 1.0)
