"""The learner: the network of a hand in torch, and its regression to expert actions."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import BasePolicy
from torch import nn

from sb3_piano.demonstrations.streaming import ShuffledRows
from sb3_piano.lab.distillation.config import NetworkSettings, Round
from sb3_piano.policies import HandsTD3Policy, set_standardization

_CONSTANT = 1e-3
"""Standard deviation below which a component of the observation counts as constant."""

_LARGEST_GRADIENT = 1.0
_RISING = 0.05
"""Share of updates with a rising learning rate."""

_REPORTED_EVERY = 20  # updates


def new_policy(settings: NetworkSettings, inputs: int, actions: int) -> HandsTD3Policy:
    """Return a policy of one hand with new weights from torch's global generator.

    Args:
        settings: Settings of the network.
        inputs: Size of a hand's observation.
        actions: Size of a hand's action.
    """
    return HandsTD3Policy(
        spaces.Box(-np.inf, np.inf, (inputs,), np.float32),
        spaces.Box(-1.0, 1.0, (actions,), np.float32),
        lambda _: 0.0,
        n_hands=1,
        net_arch={"pi": list(settings.net_arch), "qf": [1]},  # the critics are not used
        activation_fn=getattr(nn, settings.activation),
    )


def regress(
    policy: HandsTD3Policy,
    rows: ShuffledRows,
    settings: Round,
    *,
    reach: float,
    seed: int,
    on_update: Callable[[int, int, float], object] = lambda done, updates, loss: None,
) -> float:
    """Train a policy of one hand by regression to expert actions.

    The loss is Huber's, of errors in units of ``settings.huber``; the learning rate rises and then
    falls along half cosines ("one cycle", Smith and Topin 2018).

    Args:
        policy: The policy.
        rows: (N, n) observations of a hand, and (N, m) expert actions.
        settings: Settings of the training.
        reach: Change of a finger joint's angle by an action of 1, rad.
        seed: Seed of the rows' order.
        on_update: Called periodically with the number of updates, their total and the mean loss of
            the last ones. An exception from it ends the training.

    Returns:
        The mean loss of the last epoch.
    """
    parameters = list(policy.actor.parameters())
    optimizer = torch.optim.Adam(parameters, settings.learning_rate, fused=True)
    updates = settings.epochs * math.ceil(len(rows) / settings.batch_size)
    rising = min(max(_RISING, 1.5 / updates), 0.9)  # at least the first update
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.learning_rate, updates, pct_start=rising
    )
    random, scale = torch.Generator().manual_seed(seed), reach / settings.huber
    done, loss_of_epoch, recent = 0, math.nan, 0.0
    policy.set_training_mode(True)
    for _ in range(settings.epochs):
        total = 0.0
        for observations, targets in rows.batches(settings.batch_size, random):
            played = policy.actor(observations)
            loss = nn.functional.smooth_l1_loss(played * scale, targets * scale)
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(parameters, _LARGEST_GRADIENT)
            optimizer.step()
            schedule.step()
            done, value = done + 1, loss.item()
            total, recent = total + value * len(targets), recent + value
            if done % _REPORTED_EVERY == 0:
                on_update(done, updates, recent / _REPORTED_EVERY)
                recent = 0.0
        loss_of_epoch = total / len(rows)
    policy.set_training_mode(False)
    return loss_of_epoch


def standardize(policy: BasePolicy, mean: npt.NDArray[Any], std: npt.NDArray[Any]) -> None:
    """Set a policy's standardisation of observations; constant components are only shifted."""
    set_standardization(policy, mean, np.where(std < _CONSTANT, 0.0, std))
