"""Mixins of SAC, TD3 and TQC policies with their own networks.

Inherit from these before SB3's policy class and define the networks; everything else (heads of
actors, target networks, optimizers, saving) stays SB3's.
"""

from __future__ import annotations

from typing import Any

from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn


class OwnCritics(BasePolicy):
    """Mixin of policies with their own critic networks."""

    def make_critic(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        """Return new critics."""
        critic = self._stock_critic(features_extractor)
        for index, network in enumerate(critic.q_networks):
            own = self._critic_network(network[0].in_features, network[-1].out_features)
            critic.add_module(f"qf{index}", own)  # in place of the one that was there
            critic.q_networks[index] = own
        return critic.to(self.device)

    def _stock_critic(self, features_extractor: BaseFeaturesExtractor | None) -> Any:
        """Return critics with SB3's networks, as the algorithm expects them."""
        return super().make_critic(features_extractor)  # type: ignore[misc]  # of SB3's policies

    def _critic_network(self, inputs: int, outputs: int) -> nn.Module:
        """Return a new critic: from features and actions, (batch, inputs), to (batch, outputs)."""
        raise NotImplementedError


class OwnActor(BasePolicy):
    """Mixin of policies with their own actor network, without its heads."""

    actor_kwargs: dict[str, Any]

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        """Return a new actor."""
        if features_extractor is None:
            features_extractor = self.make_features_extractor()
        network, outputs = self._actor_network(features_extractor.features_dim)
        self.actor_kwargs["net_arch"] = [outputs]  # SB3 makes the heads for a last layer of these
        actor: Any = super().make_actor(features_extractor)  # type: ignore[misc]
        if hasattr(actor, "latent_pi"):
            actor.latent_pi = network
        else:  # TD3's
            actor.mu = nn.Sequential(network, *actor.mu[-2:])
        return actor.to(self.device)

    def _actor_network(self, inputs: int) -> tuple[nn.Module, int]:
        """Return a network from features, (batch, inputs), and the number of its outputs."""
        raise NotImplementedError
