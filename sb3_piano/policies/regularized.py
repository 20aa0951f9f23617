"""Policies of SAC and TD3 with regularised critics, and such ones for ``ResidualAction``."""

from __future__ import annotations

import functools
from typing import Annotated, Any, cast

import torch
from annotated_types import Ge, Lt
from stable_baselines3.common.policies import BasePolicy, ContinuousCritic
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from sb3_piano.settings import Number, checked

Layer = type[nn.Module]


class RegularizedCritic(ContinuousCritic):
    """SB3's critics, their hidden layers with dropout and layer normalisation.

    Args:
        *args: As of ``ContinuousCritic``.
        dropout: Probability with which an activation is dropped while training, in [0, 1).
        layer_norm: Whether hidden layers are normalised.
        action_cost: What is taken off the values of actions that are being optimised, times the
            mean of their squares. The values that are learnt do not have it.
        **kwargs: As of ``ContinuousCritic``.
    """

    def __init__(
        self, *args: Any, dropout: float, layer_norm: bool, action_cost: float, **kwargs: Any
    ) -> None:
        super().__init__(*args, **kwargs)
        self._action_cost = action_cost
        between = [functools.partial(_dropout, dropout)] if dropout > 0 else []
        layers = cast(list[Layer], [*between, *([nn.LayerNorm] if layer_norm else [])])
        first = cast(nn.Linear, cast(nn.Sequential, self.q_networks[0])[0])
        self.q_networks = []
        for index in range(self.n_critics):
            network = nn.Sequential(
                *create_mlp(
                    first.in_features,
                    1,
                    kwargs["net_arch"],
                    kwargs["activation_fn"],
                    post_linear_modules=layers,
                )
            )
            self.add_module(f"qf{index}", network)  # in place of the one that was there
            self.q_networks.append(network)

    def forward(self, obs: torch.Tensor, actions: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return what each critic says of actions, (n, 1)."""
        return tuple(value - self._cost(actions) for value in super().forward(obs, actions))

    def q1_forward(self, obs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Return what the first critic says of actions, (n, 1)."""
        return super().q1_forward(obs, actions) - self._cost(actions)

    def _cost(self, actions: torch.Tensor) -> torch.Tensor | float:
        # An actor's update alone differentiates by actions: those of others are data.
        if not (self._action_cost and actions.requires_grad):
            return 0.0
        return self._action_cost * actions.square().mean(dim=1, keepdim=True)


class _RegularizedCritics(BasePolicy):
    """Policies with :class:`RegularizedCritic` in place of SB3's critics."""

    critic_kwargs: dict[str, Any]

    def __init__(
        self,
        *args: Any,
        dropout: float = 0.01,
        layer_norm: bool = True,
        action_cost: float = 0.0,
        **kwargs: Any,
    ) -> None:
        self._regularization: dict[str, Any] = {
            "dropout": checked("dropout", dropout, Annotated[Number, Ge(0), Lt(1)]),
            "layer_norm": checked("layer_norm", layer_norm, bool),
            "action_cost": checked("action_cost", action_cost, Annotated[Number, Ge(0)]),
        }
        super().__init__(*args, **kwargs)

    def make_critic(
        self, features_extractor: BaseFeaturesExtractor | None = None
    ) -> RegularizedCritic:
        """Return new critics."""
        arguments = self._update_features_extractor(self.critic_kwargs, features_extractor)
        return RegularizedCritic(**arguments, **self._regularization).to(self.device)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), **self._regularization}


class RegularizedSACPolicy(_RegularizedCritics, SACPolicy):
    """SB3's ``MlpPolicy`` of SAC with regularised critics.

    Args:
        *args: As of SB3's.
        dropout: Probability with which an activation of a critic is dropped while training, 0 to
            less than 1.
        layer_norm: Whether the hidden layers of the critics are normalised.
        action_cost: How much the actor heeds the mean square of its actions, in units of the
            critics' values, 0 or more: an anchor for corrections of something that plays already.
        **kwargs: As of SB3's, such as ``net_arch``.

    Raises:
        ConfigError: If ``dropout`` or ``action_cost`` is out of range.
    """


class RegularizedTD3Policy(_RegularizedCritics, TD3Policy):
    """SB3's ``MlpPolicy`` of TD3 with regularised critics.

    Args:
        *args: As of SB3's.
        dropout: Probability with which an activation of a critic is dropped while training, 0 to
            less than 1.
        layer_norm: Whether the hidden layers of the critics are normalised.
        action_cost: How much the actor heeds the mean square of its actions, in units of the
            critics' values, 0 or more: an anchor for corrections of something that plays already.
        **kwargs: As of SB3's, such as ``net_arch``.

    Raises:
        ConfigError: If ``dropout`` or ``action_cost`` is out of range.
    """


def _dropout(probability: float, features: int) -> nn.Dropout:
    """Return dropout for a layer of any size."""
    del features
    return nn.Dropout(probability)


class _StillAtFirst(BasePolicy):
    """Policies whose actor's last layer begins at zero: training begins with the plan itself.

    Source: Silver et al. (2018), "Residual Policy Learning", section 4.
    """

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
