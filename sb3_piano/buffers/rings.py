"""Base of the compact replay buffers: rings of observations in place of SB3's arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictReplayBuffer, ReplayBuffer

from sb3_piano.arrays import Arrays
from sb3_piano.buffers.ring_observations import (
    ObservationPacking,
    RingNextObservations,
    RingObservations,
)
from sb3_piano.buffers.rows import ArrayRows, IntArray
from sb3_piano.exceptions import ConfigError

NO_NUMBERS = spaces.Box(0.0, 1.0, (0,))
"""Space for which SB3's arrays take no memory."""


class Rings(ReplayBuffer):
    """``ReplayBuffer`` with observations in rings, by name; a single array's name is "".

    Its arguments are those of ``ReplayBuffer``.

    Raises:
        ConfigError: If the class is not for such an observation space, or
            ``optimize_memory_usage`` is set.
    """

    _expected: ClassVar[str]
    """Observation spaces of a class, and the class for others: end of a message."""

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
        kind = type(self).__name__
        if optimize_memory_usage:
            raise ConfigError(
                f"optimize_memory_usage is true for a {kind}: expected false. It stores each "
                "observation once in any case, and handles time limits too."
            )
        is_dict, parts = False, {"": observation_space}
        if isinstance(observation_space, spaces.Dict):
            is_dict, parts = True, observation_space.spaces
        if is_dict != isinstance(self, DictReplayBuffer) or any(
            isinstance(part, spaces.Dict) for part in parts.values()
        ):
            raise ConfigError(
                f"A {kind} cannot hold observations of {observation_space}: expected "
                f"{self._expected}"
            )
        # Without numbers in the observations, the arrays made for them take no memory.
        super().__init__(
            buffer_size,
            spaces.Dict(dict.fromkeys(parts, NO_NUMBERS)) if is_dict else NO_NUMBERS,
            action_space,
            device,
            n_envs,
            handle_timeout_termination=handle_timeout_termination,
        )
        packings = {name: ObservationPacking(part) for name, part in parts.items()}
        self._rings = {
            name: RingObservations(packing, self.buffer_size, self.n_envs)
            for name, packing in packings.items()
        }
        self._next_rings = {n: RingNextObservations(ring) for n, ring in self._rings.items()}
        shapes = {name: packing.shape for name, packing in packings.items()}
        self.observation_space = observation_space
        self.obs_shape = shapes if is_dict else shapes[""]  # type: ignore[assignment]
        # They can do all that SB3 asks of these arrays, or dictionaries of arrays.
        stored, following = self._rings, self._next_rings
        self.observations = stored if is_dict else stored[""]  # type: ignore[assignment]
        self.next_observations = following if is_dict else following[""]  # type: ignore[assignment]

    @property
    def nbytes(self) -> int:
        """Bytes of the transitions now; the number of copied next observations varies."""
        arrays = sum(array.nbytes for array in ArrayRows(self).arrays.values())
        arrays += sum(ring.nbytes for ring in self._rings.values())
        return arrays + sum(ring.nbytes for ring in self._next_rings.values())

    def add(
        self,
        obs: Any,
        next_obs: Any,
        action: npt.NDArray[Any],
        reward: npt.NDArray[Any],
        done: npt.NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Add a transition of each environment.

        Raises:
            ConfigError: If there are more or fewer environments than the buffer is for, or they
                observe or act otherwise, as after loading the buffer of another model.
        """
        self._check("environments", len(reward), self.n_envs)
        shown = obs if isinstance(obs, dict) else {"": obs}
        for name, ring in self._rings.items():
            width = ring.packing.binary.size
            self._check(f"numbers in {name or 'an observation'}", shown[name][0].size, width)
        self._check("numbers in an action", action[0].size, self.action_dim)
        super().add(obs, next_obs, action, reward, done, infos)

    def _check(self, what: str, given: int, own: int) -> None:
        if given != own:
            raise ConfigError(
                f"The transitions are of {given} {what}, those of the {type(self).__name__} of "
                f"{own}: expected a replay buffer that was saved with as many."
            )

    def reset(self) -> None:
        """Forget all transitions."""
        super().reset()
        for ring in self._next_rings.values():
            ring.clear()

    def to_torch(self, array: npt.NDArray[Any], copy: bool = True) -> torch.Tensor:
        """Return a tensor; sampled arrays are copies already and are not copied again."""
        del copy
        return super().to_torch(array, copy=False)

    def take_rows(self, rows: IntArray) -> Arrays:
        """Return (n,) rows, up to the newest one, for saving: see ``BufferRows``."""
        taken = ArrayRows(self).take_rows(rows)
        for name, ring in self._rings.items():
            found = {**ring.take_rows(rows), **self._next_rings[name].take_rows(rows)}
            taken.update({_prefix(name) + part: array for part, array in found.items()})
        return taken

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set (n,) rows to arrays of :meth:`take_rows`.

        Raises:
            RunError: If they are rows of another kind of buffer or observation.
        """
        for name, ring in self._rings.items():
            start = _prefix(name)
            own = {n.removeprefix(start): a for n, a in saved.items() if n.startswith(start)}
            ring.put_rows(rows, own)
            self._next_rings[name].put_rows(rows, own)
        ArrayRows(self).put_rows(rows, saved)


def _prefix(name: str) -> str:
    return f"{name}." if name else ""
