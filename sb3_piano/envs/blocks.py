"""Encodings write observations block by block; a user's own blocks are checked."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import Arrays, Float32Array
from sb3_piano.envs.observation import ObservationBlock, ObservationLayout
from sb3_piano.exceptions import ConfigError
from sb3_piano.imports import import_class
from sb3_piano.music import PianoRoll
from sb3_piano.simulation import PianoScene, Simulation

if TYPE_CHECKING:
    from sb3_piano.envs.config import PianoEnvConfig

Write = Callable[[Float32Array, Any], object]
"""Function that writes the numbers of a block that depend on the state into its array."""


class Now(NamedTuple):
    """State before a control step of the piece."""

    step: int
    """Control step to play next, 0 to ``len(roll) - 1``."""
    simulation: Simulation
    """The simulation as last read."""
    pedal: float
    """The pedal's command in [0, 1]."""


class Encoding:
    """Writes observations of one layout.

    The numbers of a block that depend on the piece alone are computed when it is prepared. The
    block's :data:`Write` function then overwrites or changes them in each step.
    """

    def __init__(
        self,
        blocks: Sequence[tuple[ObservationBlock, Write | None]],
        layout: ObservationLayout | None = None,
    ):
        """Take blocks with their functions, and the layout if it differs from the blocks'."""
        self.layout = layout or ObservationLayout(block for block, _ in blocks)
        """Layout of the observation."""
        self._blocks, self._known = tuple(blocks), dict[str, Float32Array]()
        self._open_page()

    def _open_page(self) -> None:
        """Make the array that each step overwrites, and the views of it, which are not copied."""
        self._page = np.zeros(self.layout.size, dtype=np.float32)
        parts = list(zip(self._blocks, self.split(self._page), strict=True))
        found = ((out, self._known.get(block.name)) for (block, _), out in parts)
        self._fixed = [(out, known) for out, known in found if known is not None]
        self._writers = [(write, out) for (_, write), out in parts if write is not None]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_page": None, "_fixed": None, "_writers": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._open_page()

    def split(self, numbers: Float32Array) -> list[Float32Array]:
        """Split observations, (..., n), into a view for each block."""
        return [
            numbers[..., block.slice].reshape(*numbers.shape[:-1], *block.shape)
            for block in self.layout.values()
        ]

    def prepare(self, roll: PianoRoll) -> None:
        """Set the piece to play.

        Raises:
            ConfigError: If a user's block does not return finite numbers of its shape.
            ScoreError: If this encoding cannot show the piece; the former piece then remains.
        """
        raise NotImplementedError

    def _use(self, known: Mapping[str, npt.ArrayLike]) -> None:
        """Set the numbers of T control steps that depend on the piece, (T, *shape), by block."""
        self._known = {name: np.asarray(rows, dtype=np.float32) for name, rows in known.items()}
        self._open_page()

    def tables(self) -> Arrays:
        """Return data of the piece by name, one row for each control step, for batches."""
        return {}

    def known_rows(self) -> Float32Array:
        """Return the numbers of all observations that depend on the piece alone, (T, n)."""
        steps = len(next(iter(self._known.values())))
        rows = np.zeros((steps, self.layout.size), dtype=np.float32)
        for (block, _), out in zip(self._blocks, self.split(rows), strict=True):
            out[...] = self._known.get(block.name, 0.0)
        return rows

    def write(self, step: int, simulation: Simulation, pedal: float) -> Float32Array:
        """Write the observation before a control step of the piece; see :class:`Now`."""
        now = self._look(Now(step, simulation, pedal))
        for out, known in self._fixed:
            out[...] = known[step]
        for write, out in self._writers:
            write(out, now)
        return self._page.copy()

    def _look(self, now: Now) -> Any:
        """Convert the state to the type that the blocks expect."""
        return now


class Block:
    """Base class of a user's own parts of an observation.

    A subclass sets ``name``, ``meaning`` and any attributes that differ from the values here; see
    :class:`~sb3_piano.envs.ObservationBlock`. It overrides :meth:`prepare` for numbers that depend
    on the piece, :meth:`write` for numbers that depend on the simulation, or both. The
    environment's option ``observation_blocks`` takes such classes, or their import paths.

    Equal simulations in equal control steps must give equal numbers, as states can be restored. So
    a block may store data of the piece only.
    """

    name: str
    meaning: str
    shape: tuple[int, ...] = (1,)
    unit: str = "1"
    low: npt.ArrayLike = 0.0
    high: npt.ArrayLike = 1.0
    binary: bool = False

    def __init__(self, scene: PianoScene, config: PianoEnvConfig) -> None:
        """Take the scene and the settings of an environment; the shape may depend on them."""

    def prepare(self, roll: Any) -> npt.ArrayLike | None:
        """Take a piece, a ``PianoRoll`` of T control steps, before it is played.

        Returns:
            (T, *shape) numbers of each control step that depend on the piece; ``None`` if none do.
        """
        del roll
        return None

    def write(self, out: Float32Array, now: Any) -> None:
        """Write the numbers that depend on the state, a :class:`Now`, into the block's array.

        The array already holds the numbers that :meth:`prepare` returned for the control step.
        """


class AddedBlocks(Encoding):
    """Encoding with a user's blocks at its end, whose numbers are checked."""

    def __init__(self, inner: Encoding, blocks: Sequence[Block]):
        """Append blocks to those of an encoding.

        Raises:
            ConfigError: If two blocks have one name, or one lacks a valid description.
        """
        self._inner, self._added = inner, list(blocks)
        described = [_described(block) for block in blocks]
        layout = ObservationLayout([*inner.layout.values(), *described])
        super().__init__([(block, None) for block in described], layout)

    def split(self, numbers: Float32Array) -> list[Float32Array]:
        """Split observations, (..., n), into a view for each added block."""
        return super().split(numbers)[-len(self._added) :]

    def prepare(self, roll: PianoRoll) -> None:
        """Set the piece to play; see :meth:`Encoding.prepare`."""
        added = [copy.copy(block) for block in self._added]
        found = {block.name: _rows(block, block.prepare(roll), len(roll)) for block in added}
        self._inner.prepare(roll)
        self._added = added
        self._use({name: rows for name, rows in found.items() if rows is not None})

    def write(self, step: int, simulation: Simulation, pedal: float) -> Float32Array:
        """Write the observation; see :meth:`Encoding.write`.

        Raises:
            ConfigError: If a block does not write finite numbers of its shape.
        """
        page = super().write(step, simulation, pedal)
        page[: self._inner.layout.size] = self._inner.write(step, simulation, pedal)
        now = Now(step, simulation, pedal)
        for block, out in zip(self._added, self.split(page), strict=True):
            try:
                block.write(out, now)
            except (TypeError, ValueError) as error:
                raise _misfit(block, f"cannot write its numbers ({error})") from error
            if not np.isfinite(out).all():
                raise _misfit(block, f"writes {out.tolist()} in control step {step}")
        return page


def block_classes(named: Sequence[Any]) -> tuple[type[Block], ...]:
    """Resolve block classes, each given as a class or as an import path.

    Raises:
        ConfigError: If one is no block class, or cannot be imported.
    """
    found = [import_class(one, Block) if isinstance(one, str) else one for one in named]
    for one in found:
        if not isinstance(one, type) or not issubclass(one, Block):
            raise ConfigError(
                f"observation_blocks has {one!r}: expected subclasses of sb3_piano.envs.Block, or "
                "their import paths."
            )
    return tuple(found)


def _described(block: Block) -> ObservationBlock:
    names = ("name", "shape", "unit", "meaning", "low", "high", "binary")
    try:
        found = ObservationBlock(**{name: getattr(block, name) for name in names})
        np.broadcast_to(np.asarray(found.low) <= found.high, found.shape)
        return found
    except (AttributeError, TypeError, ValueError) as error:
        raise ConfigError(
            f"The observation block {type(block).__name__} does not say what it is ({error}): "
            "expected a name, a meaning, a shape, and bounds that fit it."
        ) from error


def _rows(block: Block, known: Any, steps: int) -> Float32Array | None:
    """Convert the numbers that a block prepared to an array, and check its shape."""
    if known is None:
        return None
    try:
        rows = np.asarray(known, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise _misfit(block, f"prepares no numbers ({error})") from error
    if rows.shape != (steps, *block.shape) or not np.isfinite(rows).all():
        finite = "finite" if np.isfinite(rows).all() else "not all finite"
        raise _misfit(block, f"prepares numbers of the shape {rows.shape}, {finite}")
    return rows


def _misfit(block: Block, what: str) -> ConfigError:
    return ConfigError(
        f"The observation block {block.name!r} {what}: expected finite numbers of the shape "
        f"{block.shape}; prepare() has as many for each control step."
    )
