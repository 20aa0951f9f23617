"""Values of states and actions by the critics of off-policy algorithms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from sb3_piano.arrays import Float32Array, FloatArray

_PROPOSALS = 4
"""Number of actions drawn at once, which takes little longer than one."""


def critic_values(policy: Any, observations: Any, actions: torch.Tensor) -> torch.Tensor:
    """Return each critic's value of actions, (n, critics).

    Args:
        policy: Of SAC, TD3, DDPG, TQC, CrossQ or another algorithm with a ``critic``.
        observations: n observations as the policy takes them, tensors.
        actions: (n, m) in [-1, 1], as they stand in a replay buffer.
    """
    values = policy.critic(observations, actions)
    # TQC has (n, critics, quantiles), the others a tuple of (n, 1).
    return torch.cat(values, dim=1) if isinstance(values, tuple) else values.mean(dim=2)


class PolicyValues:
    """Proposals of a model's policy, and values of its critics."""

    def __init__(
        self,
        model: OffPolicyAlgorithm,
        normalizer: VecNormalize | None,
        noise: FloatArray | float = 0.0,
        agents: int = 1,
    ):
        """Wrap a model and its ``VecNormalize``.

        ``noise`` is the standard deviation of proposals of a policy without a distribution.
        ``agents`` is the number of agents in an environment, each with an equal part of its
        observation and of its actions; the value is the mean of theirs.
        """
        self.gamma = float(model.gamma)
        self._policy: Any = model.policy
        self._policy.set_training_mode(False)
        self._normalizer = normalizer
        self._noise = noise
        self._agents = agents
        self._devices = [model.device] if model.device.type == "cuda" else []
        self._random_states = self._generators()

    def set_random_seed(self, seed: int) -> None:
        """Seed the drawing of actions."""
        with torch.random.fork_rng(self._devices):
            torch.manual_seed(seed)
            self._random_states = self._generators()

    def _generators(self) -> list[torch.Tensor]:
        """Return the states of the CPU's random generator and of the policy's device."""
        return [torch.get_rng_state(), *map(torch.cuda.get_rng_state, self._devices)]

    def copied(self, memo: dict[int, Any]) -> PolicyValues:
        """Return this object: it has no state of an environment."""
        del memo
        return self

    def reward(self, piano: Any, reward: float, info: Mapping[str, Any]) -> float:
        """Return a reward normalised as in the critics' training."""
        del piano, info
        if self._normalizer is None:
            return reward
        return float(self._normalizer.normalize_reward(np.array(reward)))

    @torch.no_grad()
    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return the critics' mean value of the policy's action, and the action."""
        seen = self._seen(observation)
        mode = self._policy._predict(seen, deterministic=True)
        (action,) = self.unscale_actions(mode)
        return float(critic_values(self._policy, seen, mode).mean()), action

    @torch.no_grad()
    def propose(self, observation: Any, mode: Float32Array) -> list[Float32Array]:
        """Draw actions from the policy; ``mode`` is its deterministic action."""
        seen = self._seen(observation)
        rows = seen.repeat(_PROPOSALS, *(1 for _ in seen.shape[1:]))
        with torch.random.fork_rng(self._devices):
            processor, *others = self._random_states
            torch.set_rng_state(processor)
            for state, device in zip(others, self._devices, strict=True):
                torch.cuda.set_rng_state(state, device)
            played = self.unscale_actions(self._policy._predict(rows, deterministic=False))
            if np.array_equal(played[0], played[1]):  # it has no distribution
                noise = self._noise * torch.randn(played.shape).numpy()
                played = np.clip(mode + noise, -1.0, 1.0).astype(np.float32)
            self._random_states = self._generators()
        return list(played)

    def _seen(self, observation: Any) -> torch.Tensor:
        """Return a row for each agent."""
        if self._agents > 1:
            observation = observation.reshape(self._agents, -1)
        if self._normalizer is not None:
            observation = self._normalizer.normalize_obs(observation)
        tensor: torch.Tensor = self._policy.obs_to_tensor(observation)[0]
        return tensor

    def unscale_actions(self, actions: torch.Tensor) -> Float32Array:
        """Rescale agents' actions from [-1, 1] to their bounds; return a row for each step."""
        played: Float32Array = self._policy.unscale_action(actions.cpu().numpy())
        return played if self._agents == 1 else played.reshape(-1, self._agents * played.shape[1])
