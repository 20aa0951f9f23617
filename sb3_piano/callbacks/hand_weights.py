"""A training that begins with a learned network of a hand."""

from __future__ import annotations

import os

import torch
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.exceptions import ConfigError
from sb3_piano.players.hand_model import SHIPPED, HandModel
from sb3_piano.policies import load_hand_weights

SIGHT_READER = "sight-reader"
"""The network that comes with the package."""


class HandWeightsCallback(BaseCallback):
    """Give a policy of hands the weights of a network before the training.

    A training that is resumed keeps its own. In YAML, for ``sb3-piano train``::

        policy: sb3_piano.policies.HandsActorCriticPolicy
        callback:
          - sb3_piano.callbacks.HandWeightsCallback:
              model: sight-reader

    Args:
        model: A file of :class:`~sb3_piano.players.HandModel`, a folder that has one, such as
            that of a distillation, or "sight-reader", the one that comes with the package.

    Raises:
        ConfigError: When training starts, if there is no such network, or it does not fit the
            policy.
    """

    def __init__(self, model: str | os.PathLike[str] = SIGHT_READER) -> None:
        super().__init__()
        self._source = model

    def _init_callback(self) -> None:
        if self.model.num_timesteps > 0:
            return
        path = SHIPPED if self._source == SIGHT_READER else self._source
        network = HandModel.load(path)
        ours = getattr(self.model.policy, "activation_fn", None)
        activation = getattr(ours, "__name__", str(ours))
        if activation != network.facts.activation:
            raise ConfigError(
                f"The policy's activation_fn is {activation}: expected "
                f"{network.facts.activation}, with which '{path}' was trained."
            )
        tensors = {name: torch.from_numpy(array) for name, array in network.tensors.items()}
        load_hand_weights(self.model.policy, tensors)

    def _on_step(self) -> bool:
        return True
