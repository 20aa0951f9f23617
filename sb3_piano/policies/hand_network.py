"""The network of one hand, shared by all hands of a policy, and its weights.

The weights depend neither on the number of hands nor on the algorithm: :func:`hand_weights` and
:func:`load_hand_weights` move them between any policies of :mod:`sb3_piano.policies.hands`, whose
deterministic actions are then equal.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import ArrayLike
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from sb3_piano.envs.hand_encoding import CLIP
from sb3_piano.exceptions import ConfigError


class PerHand(nn.Module):
    """Apply a module to each hand's block, and concatenate the results.

    Args:
        module: Module for blocks of shape (..., hands, size).
        size: Numbers of a block.
    """

    def __init__(self, module: nn.Module, size: int) -> None:
        super().__init__()
        self.module = module
        self._size = size

    def forward(self, rows: Tensor) -> Tensor:
        """Return the results for rows of shape (..., hands * size)."""
        blocks: Tensor = self.module(rows.unflatten(-1, (-1, self._size)))
        return blocks.flatten(-2)


class Standardize(BaseFeaturesExtractor):
    """Standardise and clip each hand's block by fixed numbers.

    Args:
        observation_space: Flat observations.
        n_hands: Blocks of an observation.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, observation_space: spaces.Box, n_hands: int) -> None:
        features = spaces.flatdim(observation_space)
        super().__init__(observation_space, features)
        self.register_buffer("mean", torch.zeros(features // n_hands))
        self.register_buffer("scale", torch.ones(features // n_hands))

    def forward(self, observations: Tensor) -> Tensor:
        """Return the standardised observations, of the same shape (batch, hands * n)."""
        blocks = observations.unflatten(-1, (-1, self.mean.shape[0]))
        return ((blocks - self.mean) * self.scale).clamp(-CLIP, CLIP).flatten(-2)


class HandNetwork(nn.Module):
    """Hidden layers of one hand, each normalised; the output includes the input.

    The output has the input appended, so that linear parts of the observation need not pass through
    the hidden layers.

    Args:
        inputs: Numbers of a hand's observation.
        net_arch: Sizes of the hidden layers.
        activation_fn: Activation after each.
    """

    def __init__(
        self, inputs: int, net_arch: Sequence[int], activation_fn: type[nn.Module]
    ) -> None:
        super().__init__()
        sizes = [inputs, *net_arch]
        self.hidden = nn.Sequential(
            *(
                nn.Sequential(
                    OrderedDict(
                        linear=nn.Linear(before, size),
                        norm=nn.LayerNorm(size),
                        activation=activation_fn(),
                    )
                )
                for before, size in zip(sizes, net_arch, strict=False)
            )
        )
        self.outputs = sizes[-1] + inputs

    def forward(self, observations: Tensor) -> Tensor:
        """Return the latent of shape (..., outputs) for observations of shape (..., inputs)."""
        return torch.cat([self.hidden(observations), observations], dim=-1)


class HandHead(nn.Linear):
    """Last layer of a hand's network, initialised with outputs near 0."""

    def reset_parameters(self) -> None:
        """Draw small weights."""
        nn.init.orthogonal_(self.weight, gain=0.01)
        nn.init.zeros_(self.bias)


class ConstantLogStd(nn.Module):
    """Log standard deviations independent of the state, equal for all hands.

    Args:
        actions: Actions of a hand.
        n_hands: Number of hands.
        init: The first value of all of them.
    """

    def __init__(self, actions: int, n_hands: int, init: float) -> None:
        super().__init__()
        self.values = nn.Parameter(torch.full((actions,), float(init)))
        self._n_hands = n_hands

    def forward(self, latent: Tensor) -> Tensor:
        """Return log standard deviations of shape (batch, hands * actions)."""
        return self.values.repeat(self._n_hands).expand(*latent.shape[:-1], -1)


_PARTS = {"standardize": Standardize, "network": HandNetwork, "head": HandHead}


def hand_weights(policy: BasePolicy) -> dict[str, Tensor]:
    """Return a copy of one hand's network: standardisation, hidden layers and head.

    Names are ``standardize.mean`` and ``.scale``, each of shape (n,); for the first hidden layer
    ``network.hidden.0.linear.weight`` and ``.bias``, ``network.hidden.0.norm.weight`` and
    ``.bias``, and so on for the others; ``head.weight`` and ``.bias``.

    Args:
        policy: One of :mod:`sb3_piano.policies.hands`, of any algorithm and any number of hands.

    Raises:
        ConfigError: If it is another policy.
    """
    return {
        f"{part}.{name}": tensor.detach().cpu().clone()
        for part, kind in _PARTS.items()
        for name, tensor in _all_of(policy, kind)[0].state_dict().items()
    }


def load_hand_weights(policy: BasePolicy, tensors: Mapping[str, Tensor]) -> None:
    """Load one hand's weights into a policy, target networks included.

    Exploration and critics stay as they are, but critics see what the new standardisation makes of
    observations.

    Args:
        policy: One of :mod:`sb3_piano.policies.hands`, of any algorithm and any number of hands.
        tensors: As :func:`hand_weights` returns them.

    Raises:
        ConfigError: If names or shapes do not fit; the policy is then as it was.
    """
    own = {name: tuple(tensor.shape) for name, tensor in hand_weights(policy).items()}
    if own.keys() != tensors.keys():
        different = ", ".join(sorted(own.keys() ^ tensors.keys()))
        raise ConfigError(
            f"The weights are of another network: expected those of {len(own)} names, and only one "
            f"of both has {different}. Give the policy the net_arch that they were trained with."
        )
    for name, shape in own.items():
        if tuple(tensors[name].shape) != shape:
            raise ConfigError(
                f"{name} has the shape {tuple(tensors[name].shape)}: expected {shape}. The weights "
                "are for another observation, action space or net_arch than the policy."
            )
    for part, kind in _PARTS.items():
        prefix = f"{part}."
        state = {n.removeprefix(prefix): t for n, t in tensors.items() if n.startswith(prefix)}
        for module in _all_of(policy, kind):
            module.load_state_dict(state)


def set_standardization(policy: BasePolicy, mean: ArrayLike, std: ArrayLike) -> None:
    """Set the statistics that standardise a policy's observations.

    Args:
        policy: One of :mod:`sb3_piano.policies.hands`.
        mean: Mean of each number of a hand's observation, shape (n,).
        std: Its standard deviation; where it is 0 the number is only shifted.

    Raises:
        ConfigError: If the shapes do not fit, a number is not finite or one of ``std`` below 0.
    """
    weights = hand_weights(policy)
    shape = tuple(weights["standardize.mean"].shape)
    means, stds = np.asarray(mean, np.float64), np.asarray(std, np.float64)
    for name, values in (("mean", means), ("std", stds)):
        if values.shape != shape or not np.isfinite(values).all():
            raise ConfigError(
                f"{name} has the shape {values.shape}, {np.isfinite(values).sum()} of its numbers "
                f"finite: expected finite numbers of the shape {shape}."
            )
    if (stds < 0).any():
        raise ConfigError(f"std has {stds.min():g}: expected no number below 0.")
    scale = 1 / np.where(stds > 0, stds, 1.0)
    weights["standardize.mean"] = torch.as_tensor(means, dtype=torch.float32)
    weights["standardize.scale"] = torch.as_tensor(scale, dtype=torch.float32)
    load_hand_weights(policy, weights)


def _all_of(policy: BasePolicy, kind: type[nn.Module]) -> list[nn.Module]:
    """Return a policy's modules of a class, at least one."""
    found = [module for module in policy.modules() if isinstance(module, kind)]
    if not found:
        raise ConfigError(
            f"policy is of the class {type(policy).__name__}: expected HandsSACPolicy, "
            "HandsTD3Policy or HandsActorCriticPolicy of sb3_piano.policies."
        )
    return found
