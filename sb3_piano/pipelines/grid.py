"""The grid of a sweep: what its YAML file says, and the runs that follow from it."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

from annotated_types import MinLen

from sb3_piano.exceptions import ConfigError
from sb3_piano.jobs import Resources
from sb3_piano.music import is_path, select_pieces
from sb3_piano.registration import GENERAL_ID
from sb3_piano.settings import Count, Index, Listed, settings
from sb3_piano.training import RunConfig, load_config
from sb3_piano.training.configuration.yaml_files import merged, read_yaml_mapping

_FILE = "config"
"""Setting of a sweep or a variant: the YAML file, or the name of presets, of its runs."""


@settings
class SweepConfig:
    """All settings of a sweep: its cells are every algorithm with every piece in every variant.

    Raises:
        ConfigError: If a setting is unknown, has the wrong type or is out of range.
    """

    algos: Annotated[tuple[str, ...], Listed, MinLen(1)] = ("sac",)
    """Names of algorithms."""
    pieces: Annotated[tuple[str, ...], Listed] = ()
    """What ``RoboPianist-v0`` plays: names, files, patterns, collections or lists, as for
    :func:`~sb3_piano.music.select_pieces`; each piece is a cell of its own."""
    envs: Annotated[tuple[str, ...], Listed] = ()
    """Ids of environments, which are cells beside the pieces."""
    variants: Annotated[Mapping[str, Mapping[str, Any]], MinLen(1)] = field(
        default_factory=lambda: {"": {}}
    )
    """Settings by a name that is a part of the cell's; ``config`` among them names the file."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of all runs, as in a YAML file for ``train``, such as ``n_timesteps``; those of a
    variant come before them. ``config`` is the YAML file or the name of presets."""
    seeds: Annotated[tuple[Index, ...], Listed, MinLen(1)] = (0,)
    """Seeds of each cell; each is a run of its own."""
    episodes: Count = 1
    """Episodes that each model plays when it is trained."""
    checkpoint_every: Count = 10_000
    """Environment steps between two checkpoints: what is lost at most when a process dies."""
    resources: Mapping[str, Any] = field(default_factory=dict)
    """What a run needs on a cluster: fields of :class:`~sb3_piano.jobs.Resources`."""

    def __post_init__(self) -> None:
        Resources(**self.resources)
        if not (self.pieces or self.envs):
            raise ConfigError("A sweep has neither pieces nor envs: expected at least one.")

    def runs(self) -> dict[tuple[str, int], RunConfig]:
        """Return the settings of each run by cell and seed.

        Raises:
            ConfigError: If a run's settings are not valid, or two cells have one name.
            UnknownPieceError: If there is no such piece.
        """
        played: list[tuple[str, str, dict[str, Any]]] = [(env, env, {}) for env in self.envs]
        for piece in select_pieces(self.pieces) if self.pieces else ():
            text = str(piece)
            text = os.path.realpath(text) if is_path(text) else text
            played.append((Path(text).stem, GENERAL_ID, {"score": text}))
        found: dict[tuple[str, int], RunConfig] = {}
        grid = itertools.product(self.algos, played, self.variants.items(), self.seeds)
        for algo, (title, env_id, options), (variant, changed), seed in grid:
            name = "_".join(filter(None, map(_plain, (algo, title, variant))))
            if (name, seed) in found:
                raise ConfigError(
                    f"Two cells of the sweep are called {name!r} with seed {seed}: expected "
                    "algorithms, pieces, variants and seeds that differ."
                )
            try:
                given = merged(self.settings, changed)
                given = merged(given, {"env_kwargs": options, "seed": seed})
                file = given.pop(_FILE, None)
                found[name, seed] = load_config(algo, env_id, file, **given)
            except ConfigError as error:
                raise ConfigError(f"Cell {name!r} of the sweep: {error}") from error
        return found


def load_sweep(file: str | os.PathLike[str]) -> SweepConfig:
    """Return the settings in a YAML file.

    Raises:
        ConfigError: If it cannot be read or a setting is not valid; the message names the file.
    """
    content = read_yaml_mapping(Path(file))
    try:
        return SweepConfig(**content)
    except ConfigError as error:
        raise ConfigError(f"'{file}': {error}") from error


def _plain(text: str) -> str:
    """Return a part of a cell's name, which is a folder's too."""
    return re.sub(r"[^\w.-]+", "-", text).strip("-")
