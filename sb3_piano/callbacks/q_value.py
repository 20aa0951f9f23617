"""Callback that logs Q-values."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_piano.callbacks.own_env import preserve_random_state
from sb3_piano.exceptions import ConfigError
from sb3_piano.policies.values import critic_values
from sb3_piano.settings import Count, checked


class QValueCallback(BaseCallback):
    """Log the Q-value of stored actions (``train/q_value``): SAC, TD3, DDPG, TQC, CrossQ.

    The value is the mean, over a batch of the replay buffer, of the least critic's value of the
    stored actions. The callback does not change the training. In YAML::

        callback:
          - sb3_piano.callbacks.QValueCallback: {every: 1000}

    Args:
        every: Calls between two values, at least 1; a call is one step of all environments.

    Raises:
        ConfigError: If ``every`` is out of range; when training starts, if the algorithm has no
            critics or no replay buffer.
    """

    def __init__(self, every: int = 1000) -> None:
        super().__init__()
        self._every = checked("every", every, Count)

    def _init_callback(self) -> None:
        if not isinstance(self.model, OffPolicyAlgorithm) or not hasattr(self.model, "critic"):
            raise ConfigError(
                f"{type(self.model).__name__} has no Q-values to log: expected SAC, TD3 or another "
                "algorithm with critics and a replay buffer."
            )

    def _on_step(self) -> bool:
        model = self.model
        assert isinstance(model, OffPolicyAlgorithm), "checked when training starts"
        if self.n_calls % self._every == 0 and model._n_updates > 0:
            self.logger.record("train/q_value", self._q_value(model))
        return True

    @torch.no_grad()
    def _q_value(self, model: Any) -> float:
        with preserve_random_state(model, None):
            buffer = object.__new__(type(model.replay_buffer))
            vars(buffer).update(vars(model.replay_buffer))  # a CyclingReplayBuffer counts samples
            batch = buffer.sample(model.batch_size, env=model._vec_normalize_env)
            values = critic_values(model.policy, batch.observations, batch.actions)
        return float(values.min(dim=1).values.mean())
