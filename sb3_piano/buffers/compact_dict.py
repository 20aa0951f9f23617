"""The compact replay buffer of dictionaries, such as vectors with pictures."""

from __future__ import annotations

from stable_baselines3.common.buffers import DictReplayBuffer

from sb3_piano.buffers.rings import Rings


class CompactDictReplayBuffer(Rings, DictReplayBuffer):
    """A ``DictReplayBuffer`` that holds each observation once and gives the same samples.

    What :class:`~sb3_piano.buffers.CompactReplayBuffer` does for one array it does for each of a
    ``Dict``: pictures take half the memory, the piano's vectors a tenth. Its arguments are those of
    ``DictReplayBuffer``.

    Raises:
        ConfigError: If the observation space is no ``Dict`` of plain arrays, or
            ``optimize_memory_usage`` is set.
    """

    _expected = "a Dict of plain arrays. CompactReplayBuffer holds a single array."
