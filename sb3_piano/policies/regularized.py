"""Policies of SAC, TD3 and TQC with regularised critics, such as DroQ's."""

from __future__ import annotations

import functools
from typing import Annotated, Any, cast

import torch
from annotated_types import Ge, Lt
from sb3_contrib.tqc.policies import Critic as QuantileCritic
from sb3_contrib.tqc.policies import TQCPolicy
from stable_baselines3.common.policies import ContinuousCritic
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from stable_baselines3.common.type_aliases import PyTorchObs
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from sb3_piano.policies.networks import OwnCritics
from sb3_piano.settings import NotNegative, Number, checked

Layer = type[nn.Module]


class RegularizedCritic(ContinuousCritic):
    """SB3's critics with an option to average their values in the actor's update.

    An actor's update alone differentiates by actions: in all others they are data.

    Args:
        *args: As of ``ContinuousCritic``.
        action_cost: What is taken off the values of actions that are being optimised, times the
            mean of their squares. The values that are learnt do not have it.
        mean_q: Whether actions are optimised by the mean of all critics, in place of their least
            (SAC) or the first (TD3).
        **kwargs: As of ``ContinuousCritic``.
    """

    def __init__(self, *args: Any, action_cost: float, mean_q: bool, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._action_cost, self._mean_q = action_cost, mean_q

    each = ContinuousCritic.forward
    """Method that returns each critic's values, (n, 1)."""

    def forward(self, obs: torch.Tensor, actions: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return each critic's values, (n, 1), or their mean if averaged."""
        values = self.each(obs, actions)
        if not actions.requires_grad:
            return values
        if self._mean_q:
            values = (torch.stack(values).mean(dim=0),)
        cost = _cost(self._action_cost, actions)
        return tuple(value - cost for value in values)

    def q1_forward(self, obs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Return the first critic's values, (n, 1), or the mean of all."""
        if not actions.requires_grad:
            return super().q1_forward(obs, actions)
        if self._mean_q:
            return self.forward(obs, actions)[0]
        return super().q1_forward(obs, actions) - _cost(self._action_cost, actions)


class RegularizedQuantileCritic(QuantileCritic):
    """TQC's critics with the same action cost; their mean optimises the actor anyway.

    Args:
        *args: As of TQC's ``Critic``.
        action_cost: As of :class:`RegularizedCritic`.
        mean_q: Makes no difference here.
        **kwargs: As of TQC's ``Critic``.
    """

    def __init__(self, *args: Any, action_cost: float, mean_q: bool, **kwargs: Any) -> None:
        del mean_q
        super().__init__(*args, **kwargs)
        self._action_cost = action_cost

    def forward(self, obs: PyTorchObs, action: torch.Tensor) -> torch.Tensor:
        """Return the quantiles of each critic, (n, critics, quantiles)."""
        quantiles: torch.Tensor = super().forward(obs, action)
        if not action.requires_grad:
            return quantiles
        return quantiles - _cost(self._action_cost, action)[..., None]


class RegularizedCritics(OwnCritics):
    """Mixin of policies whose critics have dropout and layer normalisation."""

    activation_fn: Layer
    critic_kwargs: dict[str, Any]
    critic_target: Any
    _critic_class: type[nn.Module] = RegularizedCritic

    def __init__(
        self,
        *args: Any,
        dropout: float = 0.01,
        layer_norm: bool = True,
        action_cost: float = 0.0,
        target_dropout: bool = False,
        mean_q: bool = False,
        **kwargs: Any,
    ) -> None:
        self._regularization: dict[str, Any] = {
            "dropout": checked("dropout", dropout, Annotated[Number, Ge(0), Lt(1)]),
            "layer_norm": checked("layer_norm", layer_norm, bool),
            "action_cost": checked("action_cost", action_cost, NotNegative),
            "target_dropout": checked("target_dropout", target_dropout, bool),
            "mean_q": checked("mean_q", mean_q, bool),
        }
        super().__init__(*args, **kwargs)

    def set_training_mode(self, mode: bool) -> None:
        """Switch dropout on or off, in target critics too (stock policies leave them)."""
        super().set_training_mode(mode)
        if self._regularization["target_dropout"]:
            for network in self.critic_target.q_networks:  # not a features extractor's statistics
                network.train(mode)

    def _stock_critic(self, features_extractor: BaseFeaturesExtractor | None) -> Any:
        arguments = self._update_features_extractor(self.critic_kwargs, features_extractor)
        own = {name: self._regularization[name] for name in ("action_cost", "mean_q")}
        return self._critic_class(**arguments, **own)

    def _critic_network(self, inputs: int, outputs: int) -> nn.Module:
        return nn.Sequential(*self._regularized_mlp(inputs, outputs))

    def _regularized_mlp(self, inputs: int, outputs: int) -> list[nn.Module]:
        """Return the layers of a critic."""
        dropout = self._regularization["dropout"]
        between = [functools.partial(_dropout, dropout)] if dropout > 0 else []
        norm = [nn.LayerNorm] if self._regularization["layer_norm"] else []
        return create_mlp(
            inputs,
            outputs,
            self.critic_kwargs["net_arch"],
            self.activation_fn,
            post_linear_modules=cast(list[Layer], [*between, *norm]),
        )

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), **self._regularization}


class RegularizedSACPolicy(RegularizedCritics, SACPolicy):
    """SAC's ``MlpPolicy`` with regularised critics.

    With ``target_dropout=True, mean_q=True`` it is DroQ under stock SAC: dropout is active in
    critics and targets during an update only; the actor maximises the mean of the critics, targets
    take their least. The algorithm's ``gradient_steps`` sets the updates for each step: 20 in the
    paper, 1 in RoboPianist. The paper updates the actor only in the last of them, stock SAC in
    each.

    Source: Hiraoka et al. (2022), "Dropout Q-Functions for Doubly Efficient Reinforcement
    Learning", algorithm 2. RoboPianist (Zakka et al. 2023) trains with it: ``dropout`` 0.01 and a
    ``net_arch`` of [256, 256, 256].

    Args:
        *args: As of SB3's.
        dropout: Probability with which an activation of a critic is dropped while training, 0 to
            less than 1.
        layer_norm: Whether the hidden layers of the critics are normalised.
        action_cost: How much the actor heeds the mean square of its actions, in units of the
            critics' values, 0 or more: an anchor for corrections of something that plays already.
        target_dropout: Whether target critics drop out, too, while training; SB3 keeps them in
            evaluation mode.
        mean_q: Whether the actor is optimised by the mean of the critics.
        **kwargs: As of SB3's, such as ``net_arch``.

    Raises:
        ConfigError: If ``dropout`` or ``action_cost`` is out of range.
    """


class RegularizedTD3Policy(RegularizedCritics, TD3Policy):
    """TD3's ``MlpPolicy`` with regularised critics; see :class:`RegularizedSACPolicy`."""


class RegularizedTQCPolicy(RegularizedCritics, TQCPolicy):
    """TQC's ``MlpPolicy`` with regularised critics; see :class:`RegularizedSACPolicy`."""

    _critic_class = RegularizedQuantileCritic


@functools.cache
def __getattr__(name: str) -> Any:
    """Return a policy class named by models of older versions: DroQ's settings."""
    former = {
        "DroQSACPolicy": RegularizedSACPolicy,
        "DroQTD3Policy": RegularizedTD3Policy,
        "DroQTQCPolicy": RegularizedTQCPolicy,
    }
    if name not in former:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    kind: Any = former[name]

    def init(
        self: Any, *args: Any, target_dropout: bool = True, mean_q: bool = True, **kwargs: Any
    ) -> None:
        kind.__init__(self, *args, target_dropout=target_dropout, mean_q=mean_q, **kwargs)

    return type(name, (kind,), {"__init__": init, "__module__": __name__})


def _cost(weight: float, actions: torch.Tensor) -> torch.Tensor:
    """Return the cost of actions in the actor's update, (n, 1)."""
    return weight * actions.square().mean(dim=1, keepdim=True)


def _dropout(probability: float, features: int) -> nn.Dropout:
    """Return a dropout layer."""
    del features
    return nn.Dropout(probability)
