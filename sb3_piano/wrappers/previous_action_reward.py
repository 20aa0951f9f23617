"""Wrapper that observes the last action and reward."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.envs.observation import ObservationBlock, ObservationLayout
from sb3_piano.exceptions import ConfigError
from sb3_piano.wrappers.piano import LayoutWrapper, layout_of


class PreviousActionReward(LayoutWrapper, gym.utils.RecordConstructorArgs):
    """Append the last action and the last reward to the observation.

    Appends the block ``previous_action``, the action of the last control step, clipped to [-1, 1]
    as the environment clips it; and ``previous_reward``, one number without bounds: the reward as
    it leaves ``env``, before wrappers further out change it. At the start of an episode both are 0.

    Source: RoboPianist (Zakka et al. 2023), its "action-reward" observation; RoboVirtuoso,
    section 3, item 5.

    Raises:
        ConfigError: If ``env`` is no piano, its actions do not lie in [-1, 1], or the blocks are
            there already.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        layout = layout_of(env, "PreviousActionReward")
        shape = _action_shape(env.action_space)
        super().__init__(env, ObservationLayout([*layout.values(), *_blocks(shape)]))
        self._action = np.zeros(shape, dtype=np.float32)
        self._reward = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; last action and reward are 0."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._action, self._reward = np.zeros_like(self._action), 0.0
        return self.observation(observation), info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step; its observation has this action and reward."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._action = np.clip(np.asarray(action), -1.0, 1.0).astype(np.float32)
        self._reward = float(reward)
        return self.observation(observation), reward, terminated, truncated, info

    def observation(self, observation: Any) -> npt.NDArray[np.float32]:
        """Return the observation with the last action and reward appended."""
        parts = (observation, self._action.reshape(-1), (self._reward,))
        return np.concatenate(parts, dtype=np.float32)


def _action_shape(space: gym.Space[Any]) -> tuple[int, ...]:
    if not isinstance(space, gym.spaces.Box) or np.any(space.low != -1) or np.any(space.high != 1):
        raise ConfigError(
            f"PreviousActionReward cannot show actions of {space}: expected a Box from -1 to 1. "
            "Put wrappers that replace it further out."
        )
    return space.shape


def _blocks(action_shape: tuple[int, ...]) -> list[ObservationBlock]:
    return [
        ObservationBlock(
            name="previous_action",
            shape=action_shape,
            meaning="the action of the control step before; 0 at the start",
            low=-1.0,
        ),
        ObservationBlock(
            name="previous_reward",
            shape=(1,),
            meaning="the reward of the control step before; 0 at the start",
            low=-np.inf,
            high=np.inf,
        ),
    ]
