"""The compact replay buffer of dictionaries, such as vectors with pictures."""

from __future__ import annotations

import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictReplayBuffer

from sb3_piano.buffers.ring_observations import ObservationPacking
from sb3_piano.buffers.rings import NO_NUMBERS, Rings, refuse_optimization
from sb3_piano.exceptions import ConfigError


class CompactDictReplayBuffer(Rings, DictReplayBuffer):
    """A ``DictReplayBuffer`` that holds each observation once and gives the same samples.

    What :class:`~sb3_piano.buffers.CompactReplayBuffer` does for one array it does for each of a
    ``Dict``: pictures take half the memory, the piano's vectors a tenth. Its arguments are those of
    ``DictReplayBuffer``.

    Raises:
        ConfigError: If the observation space is no ``Dict`` of plain arrays, or
            ``optimize_memory_usage`` is set.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Space,
        action_space: spaces.Space,
        device: torch.device | str = "auto",
        n_envs: int = 1,
        optimize_memory_usage: bool = False,
        handle_timeout_termination: bool = True,
    ):
        refuse_optimization(optimize_memory_usage, type(self).__name__)
        if not isinstance(observation_space, spaces.Dict) or any(
            isinstance(part, spaces.Dict) for part in observation_space.values()
        ):
            raise ConfigError(
                f"A CompactDictReplayBuffer cannot hold observations of {observation_space}: "
                "expected a Dict of plain arrays. CompactReplayBuffer holds a single array."
            )
        # Without numbers in the observations, the arrays made for them take no memory.
        super().__init__(
            buffer_size,
            spaces.Dict(dict.fromkeys(observation_space, NO_NUMBERS)),
            action_space,
            device,
            n_envs,
            handle_timeout_termination=handle_timeout_termination,
        )
        packings = {name: ObservationPacking(part) for name, part in observation_space.items()}
        self.observation_space = observation_space
        self.obs_shape = {name: packing.shape for name, packing in packings.items()}
        self._make_rings(packings)
        # They can do all that SB3 asks of the arrays in these two dictionaries.
        self.observations = self._rings  # type: ignore[assignment]
        self.next_observations = self._next_rings  # type: ignore[assignment]
