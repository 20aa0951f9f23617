"""Wrapper that adds an agent's corrections to the actions of a base player."""

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
    """Add ``reach`` times the agent's action to the action of a base player.

    The played action is the base player's plus ``reach`` times the agent's, clipped to [-1, 1].
    Observations are those of the environment. Inner wrappers get the played action, outer ones the
    agent's.

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
        """Mean and standard deviation, (n,), to standardise the agent's observations."""

    @abstractmethod
    def base_action(self, observation: Any) -> Float32Array:
        """Return the base player's action as a new array."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        self._seen, info = self.env.reset(seed=seed, options=options)
        return self._seen, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step with the corrected action.

        Raises:
            InvalidActionError: If the action has the wrong shape.
        """
        self._seen, *result = self.env.step(self.corrected(self._seen, action))
        return self._seen, *result

    def snapshot(self) -> Any:
        """Return the last observation, to go with ``PianoEnv.snapshot``."""
        return self._seen

    def go_back(self, moment: Any) -> None:
        """Restore a snapshot."""
        self._seen = moment

    def corrected(self, observation: Any, action: Any) -> Float32Array:
        """Return the corrected action for an observation.

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
