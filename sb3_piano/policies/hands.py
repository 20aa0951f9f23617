"""Policies of SAC, TD3, TQC and PPO in which one network plays every hand.

Observations and actions are blocks of equal size, one for each hand: two of a piece that is played
with both (right, then left, each as if it were a right hand), or one where a training treats each
hand as an agent.
"""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import PyTorchObs, Schedule
from torch import nn

from sb3_piano.envs.observation import ObservationSpace
from sb3_piano.exceptions import ConfigError
from sb3_piano.policies.hand_network import (
    ConstantLogStd,
    HandHead,
    HandNetwork,
    PerHand,
    Standardize,
)
from sb3_piano.policies.regularized import (
    RegularizedSACPolicy,
    RegularizedTD3Policy,
    RegularizedTQCPolicy,
)
from sb3_piano.settings import Count, Index, Positive, checked


class _Hands(BasePolicy):
    """Mixin of policies whose actor applies one hand's network to each hand."""

    net_arch: Any
    activation_fn: type[nn.Module]
    _defaults: ClassVar[dict[str, Any]]

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        lr_schedule: Schedule,
        n_hands: int = 2,
        critic_lr_scale: float = 1.0,
        critic_first: int = 0,
        zero_start: bool = False,
        **kwargs: Any,
    ) -> None:
        self.n_hands: int = checked("n_hands", n_hands, Count)
        self.critic_lr_scale: float = checked("critic_lr_scale", critic_lr_scale, Positive)
        self.critic_first: int = checked("critic_first", critic_first, Index)
        self.zero_start: bool = checked("zero_start", zero_start, bool)
        self._inputs = _block("observation", observation_space, self.n_hands)
        self._actions = _block("action", action_space, self.n_hands)
        _check_bounds(action_space)
        if kwargs.get("use_sde"):
            raise ConfigError(
                f"use_sde is True: expected False, {type(self).__name__} explores with noise of "
                "its own."
            )
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            features_extractor_class=Standardize,
            features_extractor_kwargs={"n_hands": self.n_hands},
            **{"activation_fn": nn.ReLU, **self._defaults, **kwargs},
        )

    def _new_network(self) -> tuple[PerHand, PerHand, int]:
        """Return the hidden layers, the head, and the number of features between them."""
        arch = self.net_arch.get("pi", []) if isinstance(self.net_arch, dict) else self.net_arch
        network = HandNetwork(self._inputs, arch, self.activation_fn)
        head = HandHead(network.outputs, self._actions)
        if self.zero_start:
            nn.init.zeros_(head.weight)
        latent = self.n_hands * network.outputs
        return PerHand(network, self._inputs), PerHand(head, network.outputs), latent

    def _new_optimizer(
        self, lr_schedule: Schedule, actor: list[nn.Parameter], critic: list[nn.Parameter]
    ) -> torch.optim.Optimizer:
        """Return an optimizer; critics' parameters have their own learning rate."""
        groups = [
            {"params": actor, "lr_scale": 1.0, "waits": self.critic_first},
            {"params": critic, "lr_scale": self.critic_lr_scale, "waits": 0},
        ]
        optimizer = self.optimizer_class(
            [group for group in groups if group["params"]],
            lr=lr_schedule(1),  # type: ignore[call-arg]
            **self.optimizer_kwargs,
        )
        optimizer.register_step_pre_hook(_scale_rates)
        optimizer.register_step_post_hook(_restore_rates)
        return optimizer

    def _get_constructor_parameters(self) -> dict[str, Any]:
        parameters = super()._get_constructor_parameters()
        del parameters["features_extractor_class"], parameters["features_extractor_kwargs"]
        own = ("n_hands", "critic_lr_scale", "critic_first", "zero_start")
        return {**parameters, **{name: getattr(self, name) for name in own}}


class _OffPolicyHands(_Hands):
    """Mixin for off-policy algorithms, whose critics take actions."""

    actor: Any
    critic: Any
    _defaults: ClassVar[dict[str, Any]] = {
        "net_arch": {"pi": [384, 384, 384], "qf": [256, 256]},
        "dropout": 0.0,
    }

    def _build(self, lr_schedule: Schedule) -> None:
        super()._build(lr_schedule)  # type: ignore[misc]  # of SB3's policies
        actor, critic = list(self.actor.parameters()), list(self.critic.parameters())
        self.actor.optimizer = self._new_optimizer(lr_schedule, actor, [])
        self.critic.optimizer = self._new_optimizer(lr_schedule, [], critic)


class _ExploringHands(_OffPolicyHands):
    """Mixin for off-policy algorithms whose actor has a distribution of actions."""

    actor_kwargs: dict[str, Any]
    _defaults: ClassVar[dict[str, Any]] = {**_OffPolicyHands._defaults, "log_std_init": -4.0}

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        """Return a new actor."""
        actor: Any = super().make_actor(features_extractor)  # type: ignore[misc]
        actor.latent_pi, actor.mu, _ = self._new_network()
        actor.log_std = ConstantLogStd(
            self._actions, self.n_hands, self.actor_kwargs["log_std_init"]
        )
        return actor.to(self.device)


class HandsSACPolicy(_ExploringHands, RegularizedSACPolicy):
    """SAC policy with one network for all hands, and small initial exploration.

    The standard deviations are a parameter independent of the state, shared by all hands.

    Args:
        observation_space: Blocks of equal size, one for each hand.
        action_space: As many blocks, from -1 to 1.
        lr_schedule: Learning rate.
        n_hands: Number of blocks.
        critic_lr_scale: Learning rate of the critics, as a multiple of the algorithm's: an actor
            that plays already bears only small steps, with which a new critic would hardly learn.
        critic_first: Number of updates in which the critics learn and the actor stays as it is: the
            advice of a new critic is worth nothing.
        zero_start: Whether actions, without exploration, are exactly 0 at first: corrections of
            something that plays already, as in :class:`~sb3_piano.players.PlayerResidual`.
        **kwargs: As of :class:`RegularizedSACPolicy`: ``net_arch`` (default: three layers of 384
            for a hand, two of 256 for a critic), ``log_std_init`` (default: -4), ``dropout`` of
            the critics (default: 0), ``action_cost``.

    Raises:
        ConfigError: If observations or actions cannot be divided so, or a setting is wrong.
    """


class HandsTQCPolicy(_ExploringHands, RegularizedTQCPolicy):
    """TQC policy with one network for all hands; arguments as of :class:`HandsSACPolicy`."""


class HandsTD3Policy(_OffPolicyHands, RegularizedTD3Policy):
    """TD3 policy with one network for all hands.

    Args:
        observation_space: Blocks of equal size, one for each hand.
        action_space: As many blocks, from -1 to 1.
        lr_schedule: Learning rate.
        n_hands: Number of blocks.
        critic_lr_scale: As of :class:`HandsSACPolicy`.
        critic_first: As of :class:`HandsSACPolicy`; the actor is updated less often than critics.
        zero_start: As of :class:`HandsSACPolicy`.
        **kwargs: As of :class:`RegularizedTD3Policy`: ``net_arch`` (default: three layers of 384
            for a hand, two of 256 for a critic), ``dropout`` of the critics (default: 0),
            ``action_cost``.

    Raises:
        ConfigError: If observations or actions cannot be divided so, or a setting is wrong.
    """

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        """Return a new actor."""
        actor = super().make_actor(features_extractor)
        hidden, head, _ = self._new_network()
        actor.mu = nn.Sequential(hidden, head, nn.Tanh())
        return actor.to(self.device)


class HandsActorCriticPolicy(_Hands, ActorCriticPolicy):
    """PPO policy with one network for all hands, and small initial exploration.

    The mean of an action is between -1 and 1; the noise is added to it, and SB3 clips the sum.

    Args:
        observation_space: Blocks of equal size, one for each hand.
        action_space: As many blocks, from -1 to 1.
        lr_schedule: Learning rate.
        n_hands: Number of blocks.
        critic_lr_scale: As of :class:`HandsSACPolicy`, for the value network.
        critic_first: As of :class:`HandsSACPolicy`, for the value network.
        zero_start: As of :class:`HandsSACPolicy`.
        anchored: Whether ``ent_coef`` weighs, in place of the entropy, how far the policy has gone
            from the weights that it was given last, by
            :func:`~sb3_piano.policies.load_hand_weights`: as the Kullback-Leibler divergence of two
            normal distributions with the same standard deviations, a hand. What was learnt from a
            teacher is then not forgotten for small gains.
        **kwargs: As of ``ActorCriticPolicy``: ``net_arch`` (default: three layers of 384 for a
            hand, two of 256 for the value), ``log_std_init`` (default: -4).

    Raises:
        ConfigError: If observations or actions cannot be divided so, or a setting is wrong.
    """

    _defaults: ClassVar[dict[str, Any]] = {
        "net_arch": {"pi": [384, 384, 384], "vf": [256, 256]},
        "log_std_init": -4.0,
    }

    def __init__(self, *args: Any, anchored: bool = False, **kwargs: Any) -> None:
        self.anchored: bool = checked("anchored", anchored, bool)
        super().__init__(*args, **kwargs)

    def evaluate_actions(
        self, obs: PyTorchObs, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Return values, log probabilities and entropies; anchored as described above."""
        values, log_probabilities, entropy = super().evaluate_actions(obs, actions)
        if self.anchored:
            features = self.features_extractor(obs)
            mean = self.action_net(self.mlp_extractor.forward_actor(features))
            with torch.no_grad():
                start = self.anchor(features)
            entropy = -0.5 * (((mean - start) / self.log_std.exp()) ** 2).sum(dim=1)
        return values, log_probabilities, entropy

    def _build(self, lr_schedule: Schedule) -> None:
        super()._build(lr_schedule)
        hidden, head, latent = self._new_network()
        self.mlp_extractor.policy_net = hidden  # type: ignore[assignment]  # SB3's is Sequential
        self.mlp_extractor.latent_dim_pi = latent
        self.action_net = nn.Sequential(head, nn.Tanh())
        if self.anchored:
            hidden_then, head_then, _ = self._new_network()
            self.anchor = nn.Sequential(hidden_then, head_then, nn.Tanh())
            self.anchor.load_state_dict(nn.Sequential(hidden, *self.action_net).state_dict())
            self.anchor.requires_grad_(requires_grad=False)
        self.to(self.device)
        actor = [*hidden.parameters(), *head.parameters(), self.log_std]
        critic = [*self.mlp_extractor.value_net.parameters(), *self.value_net.parameters()]
        self.optimizer = self._new_optimizer(lr_schedule, actor, critic)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "anchored": self.anchored}


def _scale_rates(optimizer: torch.optim.Optimizer, *arguments: Any) -> None:
    """Scale the learning rate of each group; SB3 sets the same for all, before each update."""
    del arguments
    for group in optimizer.param_groups:
        group["unscaled_lr"] = group["lr"]
        group["lr"] *= 0.0 if group["waits"] > 0 else group["lr_scale"]
        group["waits"] = max(group["waits"] - 1, 0)


def _restore_rates(optimizer: torch.optim.Optimizer, *arguments: Any) -> None:
    """Undo :func:`_scale_rates`."""
    del arguments
    for group in optimizer.param_groups:
        group["lr"] = group.pop("unscaled_lr")


def _block(what: str, space: spaces.Space[Any], n_hands: int) -> int:
    """Return the size of each hand's block in a flat space."""
    if not isinstance(space, spaces.Box) or len(space.shape) != 1:
        raise ConfigError(f"The {what} space is {space}: expected a Box of one dimension.")
    size = space.shape[0]
    if size == 0 or size % n_hands:
        raise ConfigError(
            f"n_hands is {n_hands}, the {what} space has {size} numbers: expected as many for each "
            "hand."
        )
    layout = space.layout if isinstance(space, ObservationSpace) else {}
    sizes = [block.size for block in layout.values()]
    if sizes != sizes[: len(sizes) // n_hands] * n_hands:
        raise ConfigError(
            f"n_hands is {n_hands}, the observation has the blocks {', '.join(layout)}: expected "
            'equal ones for each hand, as of the observation "hands" without observation_blocks; '
            "or n_hands=1."
        )
    return size // n_hands


def _check_bounds(space: spaces.Space[Any]) -> None:
    """Raise an error unless actions are in [-1, 1]."""
    if isinstance(space, spaces.Box) and not ((space.low == -1).all() and (space.high == 1).all()):
        raise ConfigError(
            f"The action space is from {space.low.min():g} to {space.high.max():g}: expected -1 to "
            "1. Wrap the environment in gymnasium.wrappers.RescaleAction(env, -1.0, 1.0)."
        )
