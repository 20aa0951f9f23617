"""Encodings write observations block by block; a user's own blocks are checked."""

from __future__ import annotations

import copy
import functools
from collections.abc import Mapping, Sequence
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

Parts = dict[str, Float32Array]
"""Views of the numbers of each block, by name."""


class Now(NamedTuple):
    """State before a control step of the piece."""

    step: int
    """Control step to play next, 0 to ``len(roll) - 1``."""
    simulation: Simulation
    """The simulation as last read."""
    pedal: float
    """The pedal's command in [0, 1]."""


class Encoding:
    """Base class of writers of observations of one layout.

    A subclass computes the numbers that depend on the piece alone in :meth:`_read`. In each step
    they are in the parts of the observation that :meth:`_write` then overwrites or changes.
    """

    def __init__(self, layout: ObservationLayout):
        """Take the layout."""
        self.layout = layout
        """Layout of the observation."""
        self._known: dict[str, Float32Array] = {}
        self._added: list[tuple[Block, Float32Array]] = []  # and its numbers of the piece

    def add(self, blocks: Sequence[Block]) -> None:
        """Append a user's blocks, whose numbers are checked.

        Raises:
            ConfigError: If two blocks have one name, or one lacks a valid description.
        """
        self.layout = ObservationLayout([*self.layout.values(), *map(_described, blocks)])
        self._added = [(block, np.empty(0, np.float32)) for block in blocks]

    @functools.cached_property
    def _page(self) -> tuple[Float32Array, Parts, list[Any], list[Any]]:
        """Array that each step overwrites, its parts, and those known or added with their rows."""
        page = np.zeros(self.layout.size, dtype=np.float32)
        parts, added = self.split(page), []
        for block, rows in self._added:
            added.append((page[self.layout[block.name].slice].reshape(block.shape), block, rows))
        return page, parts, [(parts[name], rows) for name, rows in self._known.items()], added

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_page"}  # has views

    def split(self, numbers: Float32Array) -> Parts:
        """Split observations, (..., n), into a view for each block of the encoding, by name."""
        return {
            name: numbers[..., block.slice].reshape(*numbers.shape[:-1], *block.shape)
            for name, block in self.layout.items()
        }

    def prepare(self, roll: PianoRoll) -> None:
        """Set the piece to play.

        Raises:
            ConfigError: If a user's block does not return finite numbers of its shape.
            ScoreError: If this encoding cannot show the piece; the former piece then remains.
        """
        added = [copy.copy(block) for block, _ in self._added]
        rows = [_rows(block, block.prepare(roll), len(roll)) for block in added]
        self._read(roll)
        self._added = list(zip(added, rows, strict=True))

    def _read(self, roll: PianoRoll) -> None:
        """Compute what depends on the piece, and :meth:`_use` it."""
        raise NotImplementedError

    def _write(self, parts: Parts, now: Now) -> None:
        """Write the numbers that depend on the state into the parts of the observation."""
        raise NotImplementedError

    def _use(self, known: Mapping[str, npt.ArrayLike]) -> None:
        """Set the numbers of T control steps that depend on the piece, (T, *shape), by block."""
        self._known = {name: np.asarray(rows, dtype=np.float32) for name, rows in known.items()}
        self.__dict__.pop("_page", None)

    def tables(self) -> Arrays:
        """Return data of the piece by name, one row for each control step.

        They are for batches, which have no added blocks.
        """
        return {}

    def known_rows(self) -> Float32Array:
        """Return the numbers of all observations that depend on the piece alone, (T, n)."""
        steps = len(next(iter(self._known.values())))
        rows = np.zeros((steps, self.layout.size), dtype=np.float32)
        parts = self.split(rows)
        for name, known in self._known.items():
            parts[name][...] = known
        return rows

    def write(self, step: int, simulation: Simulation, pedal: float) -> Float32Array:
        """Write the observation before a control step of the piece; see :class:`Now`.

        Raises:
            ConfigError: If a user's block does not write finite numbers of its shape.
        """
        now = Now(step, simulation, pedal)
        page, parts, fixed, added = self._page
        for out, known in fixed:
            out[...] = known[step]
        self._write(parts, now)
        for out, block, known in added:
            out[...] = known[step]
            try:
                block.write(out, now)
            except (TypeError, ValueError) as error:
                raise _misfit(block, f"cannot write its numbers ({error})") from error
            if not np.isfinite(out).all():
                raise _misfit(block, f"writes {out.tolist()} in control step {step}")
        return page.copy()


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


def _rows(block: Block, known: Any, steps: int) -> Float32Array:
    """Convert the numbers that a block prepared, 0 if none, to an array, and check its shape."""
    if known is None:
        return np.broadcast_to(np.float32(0.0), (steps, *block.shape))
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
