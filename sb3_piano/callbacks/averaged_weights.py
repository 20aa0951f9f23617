"""Callback that ends a training with the mean of its last weights."""

from __future__ import annotations

from typing import Annotated

import torch
from annotated_types import Ge, Lt
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.interrupts import stop_requested
from sb3_piano.settings import Number, checked


class AveragedWeightsCallback(BaseCallback):
    """Replace the policy's weights by their moving average when training ends.

    Each update of an on-policy algorithm is a noisy step; the mean of many plays better than the
    last (Izmailov et al. 2018). Training itself continues with the last weights, and so do models
    saved before the end and checkpoints of interrupted trainings; the average restarts after
    resuming. In YAML, for ``sb3-piano train``::

        callback:
          - sb3_piano.callbacks.AveragedWeightsCallback: {decay: 0.95}

    Args:
        decay: Factor of an update's weight at each later update, at least 0 and below 1: 0.95
            takes the mean of about the last 20.

    Raises:
        ConfigError: If ``decay`` is out of range.
    """

    def __init__(self, decay: float = 0.95) -> None:
        super().__init__()
        self._decay = checked("decay", decay, Annotated[Number, Ge(0), Lt(1)])
        self._average: list[torch.Tensor] = []
        self._updates = 0

    def _on_rollout_start(self) -> None:  # the update after the last roll-out is done
        self._add()

    def _on_training_end(self) -> None:
        if stop_requested() and self.num_timesteps < self.model._total_timesteps:
            return  # what is resumed goes on with the weights that its optimizer knows
        self._add()
        with torch.no_grad():
            for parameter, mean in zip(self._parameters(), self._average, strict=True):
                parameter.copy_(mean)

    def _on_step(self) -> bool:
        return True

    def _parameters(self) -> list[torch.Tensor]:
        return list(self.model.policy.parameters())

    @torch.no_grad()
    def _add(self) -> None:
        """Add the present weights to the average."""
        if not self._average:
            self._average = [parameter.clone() for parameter in self._parameters()]
        self._updates += 1
        # Of the first updates the plain mean: the very first would count too much.
        share = max(1 - self._decay, 1 / self._updates)
        for mean, parameter in zip(self._average, self._parameters(), strict=True):
            mean.lerp_(parameter, share)
