"""Callbacks that prepare a training: demonstrations, network weights, standardisation."""

from __future__ import annotations

import logging
import os

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.demonstrations import fill_replay_buffer
from sb3_piano.exceptions import ConfigError
from sb3_piano.players.hand_model import SHIPPED, SIGHT_READER, HandModel
from sb3_piano.policies.hand_network import hand_weights, load_hand_weights, set_standardization

_log = logging.getLogger(__name__)


class _AtFirst(BaseCallback):
    """Base of callbacks that act only before the first step."""

    def _on_step(self) -> bool:
        return True


class DemonstrationsCallback(_AtFirst):
    """Fill an empty replay buffer from a data set before the training.

    A resumed training restores its buffer, with the rest of the data set. With ``learning_starts:
    0`` it learns from the data set from the first step on; by default Stable-Baselines3 begins with
    random actions and learns nothing meanwhile. In YAML, for ``sb3-piano train`` and RL Zoo::

        callback:
          - sb3_piano.callbacks.DemonstrationsCallback:
              dataset: robopianist/twinkle/planned-v0

    Args:
        dataset: Name of a Minari data set, such as ``sb3-piano record`` writes.

    Raises:
        ConfigError: When training starts, if there is no such data set, or it does not fit the
            model (see :func:`~sb3_piano.demonstrations.fill_replay_buffer`).
        MissingPackageError: Then, if Minari is not installed.
    """

    def __init__(self, dataset: str) -> None:
        super().__init__()
        self._dataset = dataset

    def _init_callback(self) -> None:
        # Not at the start of training: checkpoints look at the buffer when they are initialised.
        buffer = getattr(self.model, "replay_buffer", None)
        if buffer is not None and buffer.size() > 0:
            return
        count = fill_replay_buffer(self.model, self._dataset)
        _log.info("%d transitions of %r are in the replay buffer.", count, self._dataset)


class HandWeightsCallback(_AtFirst):
    """Load the weights of a hand's network into a policy before the training.

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
        own, newest = hand_weights(self.model.policy)["standardize.mean"], network.newest()
        if own.shape == newest.tensors["standardize.mean"].shape:
            network = newest
        tensors = {name: torch.from_numpy(array) for name, array in network.tensors.items()}
        load_hand_weights(self.model.policy, tensors)


class SightReaderStandardization(_AtFirst):
    """Standardise the policy's observations as the base player does.

    For hands' policies of :mod:`sb3_piano.policies` in environments with
    :class:`~sb3_piano.players.PlayerResidual` or :class:`~sb3_piano.training.RunResidual`. If the
    base player sees both hands at once, each hand gets the statistics of both. The policy saves the
    numbers.

    Raises:
        ConfigError: When training starts, if the policy is another one.
    """

    def _on_training_start(self) -> None:
        if self.num_timesteps == 0:  # a training that goes on has them
            mean, std = self.training_env.get_attr("standardization", [0])[0]
            own = hand_weights(self.model.policy)["standardize.mean"].shape[0]
            if mean.size % own == 0:
                means, stds = mean.reshape(-1, own), std.reshape(-1, own)
                mean = means.mean(axis=0)
                std = np.sqrt((stds**2 + (means - mean) ** 2).mean(axis=0))
            set_standardization(self.model.policy, mean, std)
