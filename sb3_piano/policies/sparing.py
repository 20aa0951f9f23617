"""Faster updates of stock algorithms: skip work that has no effect.

Useless work is a third of SB3's update of SAC on a piano roll:

- Most keys of a roll are never due and never sound, so that most columns of a batch are zero: they
  add nothing to the first layer, and their weights have no gradient.
- An actor's update differentiates by the weights of the critics, too, which nobody asks for: SB3
  clears those gradients before the critics' own update.
- On a GPU each critic starts operations of its own, where all critics can be one batched product.
- Adam reads and writes all weights several times in each step, where torch's fused Adam passes over
  them once.
- The critics' weights are searched for in their modules, and moved to the targets one by one.

Networks stay the same but for rounding, as sums are computed in another order.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import recursive_getattr
from torch import Tensor, nn
from torch.nn import functional
from torch.optim import Adam

from sb3_piano.policies.batched_critics import batched_critics

_WORTHWHILE = 0.75
"""Above this share of used columns, gathering them takes longer than it saves."""

_DENSE_FOR = 50
"""Batches after a dense one that are not searched for zeros."""


class ZeroSkippingLinear(nn.Linear):
    """Linear layer that skips inputs that are zero in the whole batch."""

    always_used = 0
    """Inputs at the end that are never skipped: a critic's actions, which may all be zero and
    still have a gradient."""
    dense_for = 0
    """Number of next batches that count as dense."""

    def forward(self, input: Tensor) -> Tensor:
        """Return outputs (batch, out_features) for inputs (batch, in_features)."""
        if self.dense_for > 0 or input.shape[1:] != (self.in_features,):
            self.dense_for -= 1
            return super().forward(input)  # which refuses other shapes
        used = input.detach().abs().sum(dim=0) != 0
        used[self.in_features - self.always_used :] = True
        columns = used.nonzero().squeeze(1)
        if len(columns) > _WORTHWHILE * self.in_features:
            self.dense_for = _DENSE_FOR
            return super().forward(input)
        weight = self.weight.index_select(1, columns)
        return functional.linear(input.index_select(1, columns), weight, self.bias)


@contextlib.contextmanager
def fast_updates(model: BaseAlgorithm) -> Iterator[None]:
    """Context manager that speeds up a model's updates; it restores the model on exit.

    For SAC, TD3, DDPG, TQC and CrossQ with any policy; of other algorithms only the steps of Adam
    change. Runs use it. With SB3 alone::

        with fast_updates(model):
            model.learn(100_000)

    Args:
        model: The model. Its networks keep their parameters, so that optimizers, saving and
            loading know nothing of this.
    """
    policy: Any = model.policy
    critic = getattr(policy, "critic", None)
    with contextlib.ExitStack() as stack:
        for group in _adam_groups(model):
            group["fused"] = True
            stack.callback(group.update, fused=None)
        if critic is not None:
            stack.enter_context(_foreach_polyak(model))
            for name in ("actor", "actor_target", "critic", "critic_target"):
                if isinstance(network := getattr(policy, name, None), nn.Module):
                    stack.enter_context(_known_parameters(network))
            if model.device.type != "cpu":
                for one in (critic, getattr(policy, "critic_target", None)):
                    stack.enter_context(batched_critics(one))
            for name in ("forward", "q1_forward"):
                if hasattr(critic, name):
                    stack.enter_context(_without_own_gradients(critic, name))
            # A GPU would wait for the list of used inputs.
            on_cpu = model.device.type == "cpu"
            for layer, actions in _first_layers(policy) if on_cpu else ():
                layer.__class__ = ZeroSkippingLinear
                layer.always_used = actions
                stack.callback(_restore, layer)
        yield


def sparing_updates(model: BaseAlgorithm) -> contextlib.AbstractContextManager[None]:
    """Return :func:`fast_updates`, which had this name up to 0.2."""
    warnings.warn("sparing_updates is now fast_updates.", DeprecationWarning, stacklevel=2)
    return fast_updates(model)


def _adam_groups(model: BaseAlgorithm) -> Iterator[dict[str, Any]]:
    """Yield Adam's parameter groups on the CPU without a chosen ``fused`` or ``foreach``."""
    names, _ = model._get_torch_save_params()
    for name in names:
        optimizer = recursive_getattr(model, name)
        if isinstance(optimizer, Adam):  # or AdamW, which is one
            for group in optimizer.param_groups:
                chosen = group["fused"] is not None or group["foreach"] or group["differentiable"]
                if not chosen and all(one.device.type == "cpu" for one in group["params"]):
                    yield group


@contextlib.contextmanager
def _without_own_gradients(critic: Any, name: str) -> Iterator[None]:
    """Make a method of critics treat their weights as constants in the actor's update."""
    setattr(critic, name, partial(_with_constant_weights, critic, getattr(critic, name)))
    try:
        yield
    finally:
        vars(critic).pop(name, None)  # which hid the class's own


def _with_constant_weights(
    critic: nn.Module, method: Callable[..., Any], obs: Any, actions: Tensor
) -> Any:
    """Call a method of critics, with constant weights if actions need a gradient."""
    if not actions.requires_grad:  # an update of the critics: actions are data
        return method(obs, actions)
    learnt = [parameter for parameter in critic.parameters() if parameter.requires_grad]
    for parameter in learnt:
        parameter.requires_grad_(False)
    try:
        return method(obs, actions)
    finally:
        for parameter in learnt:
            parameter.requires_grad_(True)


@contextlib.contextmanager
def _known_parameters(network: Any) -> Iterator[None]:
    """List a network's parameters once; SB3 searches all modules for them in every update."""
    everything = list(network.parameters())

    def parameters(recurse: bool = True) -> Iterator[nn.Parameter]:
        return iter(everything) if recurse else nn.Module.parameters(network, recurse)

    network.parameters = parameters
    try:
        yield
    finally:
        vars(network).pop("parameters", None)  # which hid the class's own


@contextlib.contextmanager
def _foreach_polyak(model: BaseAlgorithm) -> Iterator[None]:
    """Move all weights of the target networks at once, to the same numbers as SB3's function."""
    train: Any = getattr(type(model), "train", None)
    names = getattr(train, "__globals__", {})
    stock = names.get("polyak_update")
    if stock is None:
        yield
        return
    names["polyak_update"] = _polyak_update
    try:
        yield
    finally:
        names["polyak_update"] = stock


@torch.no_grad()
def _polyak_update(params: Iterable[Tensor], target_params: Iterable[Tensor], tau: float) -> None:
    new, old = [*params], [*target_params]
    if len(new) != len(old):
        raise ValueError("Iterables have different lengths")  # as SB3's
    if new:
        torch._foreach_mul_(old, 1 - tau)
        torch._foreach_add_(old, new, alpha=tau)


def _first_layers(policy: Any) -> Iterator[tuple[Any, int]]:
    """Yield the first linear layers, and the number of actions among their inputs."""
    n_actions = policy.action_space.shape[0]
    for name in ("actor", "actor_target", "critic", "critic_target"):
        network = getattr(policy, name, None)
        critics = getattr(network, "q_networks", ())
        actor = getattr(network, "latent_pi", None) or getattr(network, "mu", None)
        for layers, actions in [*((one, n_actions) for one in critics), (actor, 0)]:
            if isinstance(layers, nn.Sequential) and len(layers) and type(layers[0]) is nn.Linear:
                yield layers[0], actions


def _restore(layer: Any) -> None:
    layer.__class__ = nn.Linear
    del layer.always_used
    vars(layer).pop("dense_for", None)
