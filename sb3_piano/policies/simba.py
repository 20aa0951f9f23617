"""SimBa's networks for SAC, TD3 and TQC policies of any environment.

Source: Lee et al. (2024), "SimBa: Simplicity Bias for Scaling Up Parameters in Deep Reinforcement
Learning", arXiv 2410.09754, section 4; sizes and initial weights from its authors' published code.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from gymnasium import spaces
from sb3_contrib.tqc.policies import TQCPolicy
from stable_baselines3.common.preprocessing import get_flattened_obs_dim
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, get_actor_critic_arch
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import Tensor, nn

from sb3_piano.exceptions import ConfigError
from sb3_piano.policies.networks import OwnActor, OwnCritics
from sb3_piano.settings import Count, Positive, checked

EXPANSION = 4
"""Hidden units of a block, as a multiple of its width."""


class RSNorm(BaseFeaturesExtractor):
    """Standardise observations by their running mean and variance.

    The statistics are those of all observations seen in training mode, that is in updates: acting
    and evaluating leave them alone. They are buffers, saved with the policy. Stock algorithms copy
    buffers called ``running_...`` to target networks, as they do for batch normalisation.

    Two departures from the paper, whose statistics take each observation of the environment once:
    here they come from the replay buffer's batches, in which early observations return more often;
    and results are clipped, as ``VecNormalize`` does, so that a number that was constant so far (a
    key that no piece asked for) does not drown all others when it changes.

    Args:
        observation_space: A ``Box`` of any shape, which is flattened.
        epsilon: Added to the variance, above 0.
        clip: Largest absolute value of a result, above 0.

    Raises:
        ConfigError: If the space is no ``Box`` or a number is out of range.
    """

    running_mean: Tensor
    running_var: Tensor
    running_count: Tensor

    def __init__(
        self, observation_space: spaces.Space[Any], epsilon: float = 1e-5, clip: float = 10.0
    ) -> None:
        if not isinstance(observation_space, spaces.Box):
            raise ConfigError(
                f"The observation space is {observation_space}: expected a Box, whose numbers are "
                "standardised. Give policy_kwargs another features_extractor_class."
            )
        features = get_flattened_obs_dim(observation_space)
        super().__init__(observation_space, features)
        self.epsilon = checked("epsilon", epsilon, Positive)
        self.clip = checked("clip", clip, Positive)
        self.register_buffer("running_mean", torch.zeros(features))
        self.register_buffer("running_var", torch.ones(features))
        # A float, since SB3 copies to targets by multiplying with 0.0.
        self.register_buffer("running_count", torch.zeros(()))

    def forward(self, observations: Tensor) -> Tensor:
        """Return standardised observations, (batch, features)."""
        features = observations.flatten(1)
        if self.training:
            self._update(features)
        scaled = (features - self.running_mean) * (self.running_var + self.epsilon).rsqrt()
        return scaled.clamp(-self.clip, self.clip)

    @torch.no_grad()
    def _update(self, batch: Tensor) -> None:
        """Merge the moments of a batch into the running ones (Chan et al. 1979), in place."""
        variance, mean = torch.var_mean(batch, dim=0, correction=0)
        delta, before = mean - self.running_mean, self.running_count.clone()
        self.running_count += len(batch)
        share = len(batch) / self.running_count
        self.running_mean += delta * share
        squares = self.running_var * before + variance * len(batch)
        self.running_var.copy_(squares / self.running_count + delta**2 * (1 - share) * share)


class SimbaBlock(nn.Module):
    """A pre-norm residual block: x + Linear(activation(Linear(LayerNorm(x)))).

    Args:
        width: Number of inputs and outputs.
        activation_fn: Activation of the hidden layer, which has :data:`EXPANSION` times as many.
    """

    def __init__(self, width: int, activation_fn: type[nn.Module]) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.hidden = nn.Linear(width, EXPANSION * width)
        self.activation = activation_fn()
        self.output = nn.Linear(EXPANSION * width, width)
        for layer in (self.hidden, self.output):
            nn.init.kaiming_normal_(layer.weight)
            nn.init.zeros_(layer.bias)

    def forward(self, inputs: Tensor) -> Tensor:
        """Return (batch, width) for (batch, width)."""
        result: Tensor = inputs + self.output(self.activation(self.hidden(self.norm(inputs))))
        return result


def simba_network(
    inputs: int, widths: Sequence[int], activation_fn: type[nn.Module]
) -> nn.Sequential:
    """Return SimBa's network: a linear layer, residual blocks, layer normalisation.

    Args:
        inputs: Number of inputs.
        widths: Width of each block, all equal.
        activation_fn: Activation within the blocks.
    """
    width = widths[0]
    first = nn.Linear(inputs, width)
    nn.init.orthogonal_(first.weight)
    nn.init.zeros_(first.bias)
    blocks = nn.Sequential(*(SimbaBlock(width, activation_fn) for _ in widths))
    return nn.Sequential(OrderedDict(linear=first, blocks=blocks, norm=nn.LayerNorm(width)))


class _Simba(OwnActor, OwnCritics):
    """Mixin of policies whose actor and critics are SimBa networks."""

    net_arch: Any
    activation_fn: type[nn.Module]

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Box,
        lr_schedule: Schedule,
        net_arch: list[int] | dict[str, list[int]] | None = None,
        features_extractor_class: type[BaseFeaturesExtractor] = RSNorm,
        optimizer_class: type[torch.optim.Optimizer] = torch.optim.AdamW,  # weight decay 0.01
        **kwargs: Any,
    ) -> None:
        if net_arch is None:
            net_arch = {"pi": [128], "qf": [512, 512]}
        _check_blocks(net_arch)
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            net_arch=net_arch,
            features_extractor_class=features_extractor_class,
            optimizer_class=optimizer_class,
            **kwargs,
        )

    def _actor_network(self, inputs: int) -> tuple[nn.Module, int]:
        widths, _ = get_actor_critic_arch(self.net_arch)
        return simba_network(inputs, widths, self.activation_fn), widths[0]

    def _critic_network(self, inputs: int, outputs: int) -> nn.Module:
        _, widths = get_actor_critic_arch(self.net_arch)
        network = simba_network(inputs, widths, self.activation_fn)
        network.append(nn.Linear(widths[0], outputs))
        return network


class SimbaSACPolicy(_Simba, SACPolicy):
    """SAC policy with SimBa networks.

    The paper trains them with a learning rate of 1e-4, two updates a step, ``ent_coef`` from 0.01
    and a target entropy of minus half the number of actions: settings of the algorithm.

    Args:
        observation_space: A ``Box``.
        action_space: A ``Box``.
        lr_schedule: Learning rate.
        net_arch: The width of each residual block, of actor (``pi``) and critics (``qf``), equal
            within each: by default, the paper's, one of 128 and two of 512.
        features_extractor_class: By default :class:`RSNorm`; ``FlattenExtractor`` where
            ``VecNormalize`` standardises already.
        optimizer_class: By default ``AdamW``, with the paper's weight decay of 0.01.
        **kwargs: As of SB3's.

    Raises:
        ConfigError: If ``net_arch`` has no blocks or blocks of different widths, or the observation
            space is no ``Box``.
    """


class SimbaTD3Policy(_Simba, TD3Policy):
    """TD3 policy with SimBa networks; arguments of :class:`SimbaSACPolicy`."""


class SimbaTQCPolicy(_Simba, TQCPolicy):
    """TQC policy with SimBa networks; arguments of :class:`SimbaSACPolicy`."""


def _check_blocks(net_arch: Any) -> None:
    """Raise an error unless actor and critics have at least one block width each."""
    of_each = net_arch if isinstance(net_arch, Mapping) else {"pi": net_arch, "qf": net_arch}
    if set(of_each) != {"pi", "qf"}:
        raise ConfigError(f"net_arch has {', '.join(map(str, of_each))}: expected 'pi' and 'qf'.")
    for name, widths in of_each.items():
        for width in checked(f"net_arch of {name!r}", widths, list[Count]):
            if width != widths[0]:
                raise ConfigError(
                    f"net_arch of {name!r} is {widths}: expected equal numbers, the width of each "
                    "residual block."
                )
        if not widths:
            raise ConfigError(f"net_arch of {name!r} is []: expected one residual block or more.")
