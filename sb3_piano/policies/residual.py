"""Policies for ``ResidualAction``, which begin by adding nothing to the plan.

Source: Silver et al. (2018), "Residual Policy Learning", section 4: the last layer of the actor
begins at zero, so that training begins with the initial controller itself.
"""

from __future__ import annotations

from typing import Any

from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from sb3_piano.policies.regularized import RegularizedSACPolicy, RegularizedTD3Policy


class _StillAtFirst(BasePolicy):
    """What both policies have in common."""

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        """Return a new actor whose actions are 0 until it has learnt something."""
        actor = super().make_actor(features_extractor)  # type: ignore[misc]  # of SB3's policies
        last = [layer for layer in actor.mu.modules() if isinstance(layer, nn.Linear)][-1]
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        return actor


class ResidualTD3Policy(_StillAtFirst, RegularizedTD3Policy):
    """:class:`RegularizedTD3Policy` whose actions are 0 at first.

    Args:
        *args: As of SB3's.
        **kwargs: As of :class:`RegularizedTD3Policy`.
    """


class ResidualSACPolicy(_StillAtFirst, RegularizedSACPolicy):
    """:class:`RegularizedSACPolicy` whose actions, when it does not explore, are 0 at first.

    Args:
        *args: As of SB3's.
        **kwargs: As of :class:`RegularizedSACPolicy`.
    """
