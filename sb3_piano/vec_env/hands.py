"""Vector environment of Stable-Baselines3 in which each hand is an agent."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import (
    VecEnvIndices,
    VecEnvObs,
    VecEnvStepReturn,
)

from sb3_piano.exceptions import ConfigError
from sb3_piano.wrappers.hand_reward import HAND_REWARDS, HandReward


class HandsAsAgents(VecEnvWrapper):
    """Present each hand as an environment, so that one policy learns for both.

    Environment ``2 i`` is the right hand of environment ``i``, ``2 i + 1`` the left one; in scenes
    with one hand, environment ``i`` is that hand. Each hand has its part of the observation "hands"
    and of the actions of :class:`~sb3_piano.wrappers.HandActions`, and its reward of
    :class:`~sb3_piano.wrappers.HandReward`; both end together. The learned network is that of one
    hand (``policy_kwargs: {n_hands: 1}`` of the policies of :mod:`sb3_piano.policies`).

    In a run's YAML: ``vec_env_wrapper: sb3_piano.vec_env.HandsAsAgents``.

    Args:
        venv: Pianos whose observations and actions have a part of equal meaning for each hand, each
            with a :class:`~sb3_piano.wrappers.HandReward`.

    Raises:
        ConfigError: If a piano lacks one of these.
    """

    def __init__(self, venv: VecEnv) -> None:
        try:
            self._hands = hands = len(venv.get_attr("config", 0)[0].sides)
        except AttributeError:  # no piano
            self._hands = hands = 0
        both = {"observation": venv.observation_space, "action": venv.action_space}
        spaces = [_of_hand(what, space, hands) for what, space in both.items()]
        if not all(venv.env_is_wrapped(HandReward)):
            raise ConfigError(
                "HandsAsAgents finds no reward of each hand: expected "
                "sb3_piano.wrappers.HandReward around every environment."
            )
        super().__init__(venv, *spaces)
        self.num_envs = hands * venv.num_envs

    def reset(self) -> VecEnvObs:
        """Begin an episode in every environment."""
        observations = self._parts(self.venv.reset())
        self.reset_infos = [info for info in self.venv.reset_infos for _ in range(self._hands)]
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Start a step with the actions of all hands."""
        self.venv.step_async(actions.reshape(self.venv.num_envs, -1))

    def step_wait(self) -> VecEnvStepReturn:
        """Return observation, reward, done and info of each hand."""
        observations, _, dones, infos = self.venv.step_wait()
        rewards = np.array([info[HAND_REWARDS] for info in infos], dtype=np.float32)
        of_hands = _of_hands(infos, self._hands)
        return self._parts(observations), rewards.reshape(-1), dones.repeat(self._hands), of_hands

    def env_method(
        self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the hands' environments."""
        inside = self._inside(indices)
        return self.venv.env_method(method_name, *args, indices=inside, **kwargs)

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the hands' environments."""
        return self.venv.get_attr(attr_name, self._inside(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the hands' environments."""
        self.venv.set_attr(attr_name, value, self._inside(indices))

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return whether the hands' environments have a wrapper."""
        return self.venv.env_is_wrapped(wrapper_class, self._inside(indices))

    def _parts(self, observations: VecEnvObs) -> np.ndarray:
        assert isinstance(observations, np.ndarray), "boxes alone have parts"
        return observations.reshape(self.num_envs, -1)

    def _inside(self, indices: VecEnvIndices) -> list[int]:
        return [hand // self._hands for hand in self._get_indices(indices)]


def _of_hand(what: str, space: gym.Space[Any], hands: int) -> gym.spaces.Box:
    """Return the space of one hand."""
    numbers = space.shape[0] if space.shape is not None and len(space.shape) == 1 else 0
    if isinstance(space, gym.spaces.Box) and hands and numbers and numbers % hands == 0:
        low, high = space.low.reshape(hands, -1), space.high.reshape(hands, -1)
        if np.array_equal(low[0], low[-1]) and np.array_equal(high[0], high[-1]):
            return gym.spaces.Box(low[0], high[0], dtype=space.dtype.type)
    raise ConfigError(
        f"HandsAsAgents cannot give each hand a part of the {what} space, {type(space).__name__} "
        f"of {numbers} numbers: expected parts with equal bounds, as of the observation "
        '"hands" without further blocks (HindsightFlag\'s, say) and of '
        "sb3_piano.wrappers.HandActions."
    )


def _of_hands(infos: list[dict[str, Any]], hands: int) -> list[dict[str, Any]]:
    """Return the info of each hand; all share the episode's.

    SB3's ``evaluate_policy`` waits for an episode of each environment.
    """
    result = []
    for info in infos:
        ends = info.get("terminal_observation")
        for hand in range(hands):
            own = dict(info)
            if ends is not None:
                own["terminal_observation"] = ends.reshape(hands, -1)[hand]
            result.append(own)
    return result
