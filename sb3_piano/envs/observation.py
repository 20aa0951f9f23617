"""Layout of the observation vector, and its restriction to a range of keys."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_piano.arrays import IntArray
from sb3_piano.exceptions import ConfigError
from sb3_piano.files import read_table
from sb3_piano.music.constants import MIN_PITCH, NUM_KEYS
from sb3_piano.music.key_window import KeyWindow
from sb3_piano.music.pitch import pitch_name


@dataclass(frozen=True, kw_only=True, eq=False)
class ObservationBlock:
    """Description of one named part of the observation vector."""

    name: str
    """Name of the block, by which wrappers find it."""
    shape: tuple[int, ...] = (1,)
    """Shape of the block before flattening (row-major)."""
    unit: str = "1"
    """Unit of its numbers; "1" for pure numbers."""
    meaning: str
    """Meaning of its numbers, in one sentence."""
    low: npt.ArrayLike = 0.0
    """Least value of its numbers; broadcast to the shape."""
    high: npt.ArrayLike = 1.0
    """Greatest value of its numbers; broadcast to the shape."""
    binary: bool = False
    """Whether its numbers are always 0 or 1."""
    columns: IntArray | None = None
    """(n,) remaining indices of the last axis of a restricted block; ``None`` if all remain."""
    start: int = 0
    """First index in the observation vector."""

    @property
    def size(self) -> int:
        """Size of the block."""
        return math.prod(self.shape)

    @property
    def slice(self) -> slice:
        """Place of the block in the observation vector."""
        return slice(self.start, self.start + self.size)

    @property
    def all_columns(self) -> IntArray:
        """(n,) remaining indices of its last axis before any restriction."""
        return np.arange(self.shape[-1]) if self.columns is None else self.columns

    def restrict(self, kept: IntArray) -> ObservationBlock:
        """Restrict the block to some indices of its last axis."""
        low, high = (np.broadcast_to(b, self.shape)[..., kept] for b in (self.low, self.high))
        shape, columns = (*self.shape[:-1], len(kept)), self.all_columns[kept]
        return dataclasses.replace(self, shape=shape, low=low, high=high, columns=columns)


_TABLE: dict[str, dict[str, Any]] = read_table(Path(__file__).with_suffix(".yml"))


def described(row: str, values: Mapping[str, Any], name: str = "") -> ObservationBlock:
    """Describe a block by a row of ``observation.yml``.

    Args:
        row: Key of the row.
        values: Sizes, bounds and texts that the row names.
        name: Name of the block, by default the row's.
    """

    def value(given: Any) -> Any:
        if isinstance(given, list):
            return tuple(value(one) for one in given)
        if not isinstance(given, str):
            return given
        return -values[given[1:]] if given.startswith("-") else values[given]

    facts = dict(_TABLE[row])
    unit, meaning = facts.pop("unit", "1"), facts.pop("meaning").format(**values)
    found = {field: value(given) for field, given in facts.items()}
    return ObservationBlock(name=name or row, unit=unit, meaning=meaning, **found)


class ObservationLayout(Mapping[str, ObservationBlock]):
    """Mapping of the blocks of an observation vector by name, in order and without gaps."""

    def __init__(self, blocks: Iterable[ObservationBlock]):
        """Lay out blocks one after the other; their former ``start`` is ignored.

        Raises:
            ConfigError: If two have one name.
        """
        self._blocks: dict[str, ObservationBlock] = {}
        start = 0
        for block in blocks:
            if block.name in self._blocks:
                raise ConfigError(
                    f"Two blocks of the observation are called {block.name!r}: expected names that "
                    "differ. A wrapper that adds a block can be used only once."
                )
            self._blocks[block.name] = dataclasses.replace(block, start=start)
            start += block.size
        self.size = start
        """Size of the observation."""

    def __getitem__(self, name: str) -> ObservationBlock:
        return self._blocks[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._blocks)

    def __len__(self) -> int:
        return len(self._blocks)

    def __repr__(self) -> str:
        blocks = ", ".join(f"{b.name}[{b.start}:{b.start + b.size}]" for b in self.values())
        return f"ObservationLayout({blocks})"

    def restrict(self, kept: Mapping[str, IntArray]) -> tuple[ObservationLayout, IntArray]:
        """Restrict blocks, by name, to some indices of their last axis, such as keys of the goal.

        Returns:
            The layout of the shorter vector, and (its size,) the indices of its numbers in the
            vector of this layout.
        """
        blocks, columns = [], []
        for block in self.values():
            indices = np.arange(block.start, block.start + block.size).reshape(block.shape)
            if block.name in kept:
                block, indices = block.restrict(kept[block.name]), indices[..., kept[block.name]]
            blocks.append(block)
            columns.append(indices.reshape(-1))
        return ObservationLayout(blocks), np.concatenate(columns)


class ObservationSpace(spaces.Box):
    """Flat ``Box`` of float32 with the layout of its blocks.

    Feature extractors and replay buffers, which get only a space from Stable-Baselines3, can read
    its ``layout``. A wrapper that replaces it by an ordinary ``Box`` hides the layout.
    """

    def __init__(self, layout: ObservationLayout):
        """Take bounds and size from a layout."""
        lows = [np.broadcast_to(block.low, block.shape).ravel() for block in layout.values()]
        highs = [np.broadcast_to(block.high, block.shape).ravel() for block in layout.values()]
        low, high = (np.hstack(each, dtype=np.float32) for each in (lows, highs))
        super().__init__(low, high, dtype=np.float32)
        self.layout = layout
        """Layout: name, place and meaning of each block."""


def restrict_to(window: KeyWindow, layout: ObservationLayout) -> tuple[ObservationLayout, IntArray]:
    """Restrict the goal and the key state of a layout to a window; see its ``restrict``.

    Both blocks may have been restricted before.

    Raises:
        ConfigError: If the layout lacks keys of the window.
    """
    keys, kept = list(range(window.first, window.last + 1)), {}
    for name, wanted in (("goal", [*keys, NUM_KEYS]), ("key_state", keys)):
        position = {column: i for i, column in enumerate(layout[name].all_columns.tolist())}
        missing = [column for column in wanted if column not in position]
        if missing:
            raise ConfigError(
                f"The keys {window} cannot be cut out of the block {name!r}: "
                f"{len(missing)} of them were cut before, such as "
                f"{pitch_name(missing[0] + MIN_PITCH)}. Expected keys that the block shows."
            )
        kept[name] = np.array([position[column] for column in wanted])
    return layout.restrict(kept)
