"""Blocks of an observation, and the encoding that writes them."""

from __future__ import annotations

import copy
from collections.abc import Sequence
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


class Now(NamedTuple):
    """State before a control step of the piece."""

    step: int
    """Control step to play next, 0 to ``len(roll) - 1``."""
    simulation: Simulation
    """The simulation as last read."""
    pedal: float
    """The pedal's command in [0, 1]."""


class Block:
    """Base class of the named parts of an observation.

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

    def tables(self) -> Arrays:
        """Return other data of the piece by name, one row for each control step."""
        return {}

    def described(self, prefix: str = "") -> ObservationBlock:
        """Describe the block for the layout, with a prefix before its name."""
        facts = ("shape", "unit", "meaning", "low", "high", "binary")
        return ObservationBlock(
            name=f"{prefix}{self.name}", **{fact: getattr(self, fact) for fact in facts}
        )


class Encoding:
    """Writes observations of one layout, block by block."""

    def __init__(self, blocks: Sequence[Block], layout: ObservationLayout):
        """Take blocks and the layout of their numbers."""
        self.layout = layout
        """Layout of the observation."""
        self._blocks = tuple(blocks)
        self._known: tuple[Float32Array | None, ...] = (None,) * len(blocks)
        self._open_page()

    def _open_page(self) -> None:
        """Make the array that each step overwrites, and the views of it, which are not copied."""
        self._page = np.zeros(self.layout.size, dtype=np.float32)
        self._outs = self.split(self._page)
        parts = list(zip(self._blocks, self._outs, self._known, strict=True))
        self._fixed = [(out, known) for _, out, known in parts if known is not None]
        writes = Block.write
        self._writers = [(b.write, out) for b, out, _ in parts if type(b).write is not writes]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_page": None, "_outs": None, "_fixed": None, "_writers": None}

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
            ConfigError: If a block does not return finite numbers of its shape.
            ScoreError: If this encoding cannot show the piece; the former piece then remains.
        """
        self._use(self._prepared(roll, len(roll)))

    def _prepared(self, piece: Any, steps: int) -> list[tuple[Block, Float32Array | None]]:
        """Prepare copies of the blocks for a piece; return them with their known numbers."""
        blocks = [copy.copy(block) for block in self._blocks]
        return [
            (block, _rows(block, block.prepare(piece), (steps, *out.shape)))
            for block, out in zip(blocks, self._outs, strict=True)
        ]

    def _use(self, prepared: list[tuple[Block, Float32Array | None]]) -> None:
        self._blocks, self._known = zip(*prepared, strict=True)
        self._open_page()

    def tables(self) -> Arrays:
        """Return the blocks' data of the piece by name, one row for each control step."""
        return {name: table for block in self._blocks for name, table in block.tables().items()}

    def known_rows(self) -> Float32Array:
        """Return the numbers of all observations that depend on the piece alone, (T, n)."""
        steps = next(len(known) for known in self._known if known is not None)
        rows = np.zeros((steps, self.layout.size), dtype=np.float32)
        for out, known in zip(self.split(rows), self._known, strict=True):
            if known is not None:
                out[...] = known
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


class AddedBlocks(Encoding):
    """Encoding with a user's blocks at its end, whose numbers are checked."""

    def __init__(self, inner: Encoding, blocks: Sequence[Block]):
        """Append blocks to those of an encoding.

        Raises:
            ConfigError: If two blocks have one name, or one lacks a valid description.
        """
        self._inner = inner
        added = [_described(block) for block in blocks]
        super().__init__(blocks, ObservationLayout([*inner.layout.values(), *added]))

    def split(self, numbers: Float32Array) -> list[Float32Array]:
        """Split observations, (..., n), into a view for each added block."""
        return super().split(numbers)[-len(self._blocks) :]

    def prepare(self, roll: PianoRoll) -> None:
        """Set the piece to play; see :meth:`Encoding.prepare`."""
        prepared = self._prepared(roll, len(roll))
        self._inner.prepare(roll)
        self._use(prepared)

    def write(self, step: int, simulation: Simulation, pedal: float) -> Float32Array:
        """Write the observation; see :meth:`Encoding.write`.

        Raises:
            ConfigError: If a block does not write finite numbers of its shape.
        """
        inner, now = self._inner.write(step, simulation, pedal), Now(step, simulation, pedal)
        self._page[: inner.size] = inner
        self._page[inner.size :] = 0.0
        for block, out, known in zip(self._blocks, self._outs, self._known, strict=True):
            if known is not None:
                out[...] = known[step]
            try:
                block.write(out, now)
            except (TypeError, ValueError) as error:
                raise _misfit(block, f"cannot write its numbers ({error})") from error
            if not np.isfinite(out).all():
                raise _misfit(block, f"writes {out.tolist()} in control step {step}")
        return self._page.copy()


def block_classes(named: Sequence[Any]) -> tuple[type[Block], ...]:
    """Resolve block classes, each given as a class or as an import path.

    Raises:
        ConfigError: If one is no block class, or cannot be imported.
    """
    return tuple(map(_block_class, named))


def _block_class(named: Any) -> type[Block]:
    if isinstance(named, str):
        return import_class(named, Block)
    if isinstance(named, type) and issubclass(named, Block):
        return named
    raise ConfigError(
        f"observation_blocks has {named!r}: expected subclasses of sb3_piano.envs.Block, or their "
        "import paths."
    )


def _described(block: Block) -> ObservationBlock:
    try:
        found = block.described()
        np.broadcast_to(np.asarray(found.low) <= found.high, found.shape)
        return found
    except (AttributeError, TypeError, ValueError) as error:
        raise ConfigError(
            f"The observation block {type(block).__name__} does not say what it is ({error}): "
            "expected a name, a meaning, a shape, and bounds that fit it."
        ) from error


def _rows(block: Block, known: Any, shape: tuple[int, ...]) -> Float32Array | None:
    """Convert the numbers that a block prepared to an array, and check its shape."""
    if known is None:
        return None
    try:
        rows = np.asarray(known, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise _misfit(block, f"prepares no numbers ({error})") from error
    if rows.shape != shape or not np.isfinite(rows).all():
        finite = "finite" if np.isfinite(rows).all() else "not all finite"
        raise _misfit(block, f"prepares numbers of the shape {rows.shape}, {finite}")
    return rows


def _misfit(block: Block, what: str) -> ConfigError:
    return ConfigError(
        f"The observation block {block.name!r} {what}: expected finite numbers of the shape "
        f"{block.shape}; prepare() has as many for each control step."
    )
