"""A training that begins with recorded performances in its replay buffer."""

from __future__ import annotations

import logging

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.demonstrations import fill_replay_buffer

_log = logging.getLogger(__name__)


class DemonstrationsCallback(BaseCallback):
    """Fill the replay buffer from a data set before the training, unless something is in it.

    A training that is resumed has its buffer back, with what is left of the data set in it. With
    ``learning_starts: 0`` it learns from the data set from the first step on; by default
    Stable-Baselines3 begins by acting at random, and learns nothing meanwhile. In YAML, for
    ``sb3-piano train`` and RL Zoo::

        callback:
          - sb3_piano.callbacks.DemonstrationsCallback:
              dataset: robopianist/twinkle/planned-v0

    Args:
        dataset: Name of a Minari data set, such as ``sb3-piano record`` writes.

    Raises:
        ConfigError: When training starts, if there is no such data set, or it does not fit the
            model (see :func:`~sb3_piano.demonstrations.fill_replay_buffer`).
        ImportError: Then, if Minari is not installed.
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

    def _on_step(self) -> bool:
        return True
