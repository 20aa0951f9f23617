"""Values of states and actions, as the critics of off-policy algorithms see them."""

from __future__ import annotations

from typing import Any

import torch


def critic_values(policy: Any, observations: Any, actions: torch.Tensor) -> torch.Tensor:
    """Return the value that each critic of a policy gives to actions, (n, critics).

    Args:
        policy: Of SAC, TD3, DDPG, TQC, CrossQ or another algorithm with a ``critic``.
        observations: n observations as the policy takes them, tensors.
        actions: (n, m) in [-1, 1], as they stand in a replay buffer.
    """
    values = policy.critic(observations, actions)
    # TQC has (n, critics, quantiles), the others a tuple of (n, 1).
    return torch.cat(values, dim=1) if isinstance(values, tuple) else values.mean(dim=2)
