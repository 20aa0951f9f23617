"""Train a sweep: one job for each run of a grid, in one folder."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

from annotated_types import MinLen

from sb3_piano.exceptions import ConfigError, RunError, naming
from sb3_piano.files import load_yaml, write_csv, write_yaml
from sb3_piano.hyperparams import DEFAULT_ALGORITHM
from sb3_piano.jobs import Outcome, Resources, finish, status
from sb3_piano.jobs.folders import is_empty, shared_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.music import select_pieces
from sb3_piano.music.catalogue import is_path
from sb3_piano.pipelines.training import TrainingJob
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.registration import GENERAL_ID
from sb3_piano.settings import Count, Index, Listed, Nested, settings
from sb3_piano.training import load_config
from sb3_piano.training.configuration.yaml_files import merged

RESULTS = "results.csv"
_FORMER = "sweep.yml"  # of earlier versions, with the settings of all runs


@settings
class SweepConfig:
    """All settings of a sweep: each cell is an algorithm with a piece in a variant."""

    algos: Annotated[tuple[str, ...], Listed, MinLen(1)] = (DEFAULT_ALGORITHM,)
    """Names of algorithms."""
    pieces: Annotated[tuple[str, ...], Listed] = ()
    """Pieces for ``RoboPianist-v0``: entries of :func:`~sb3_piano.music.select_pieces`; each is a
    cell of its own."""
    envs: Annotated[tuple[str, ...], Listed] = ()
    """Ids of environments, each a cell beside the pieces."""
    variants: Annotated[Mapping[str, Mapping[str, Any]], MinLen(1)] = field(
        default_factory=lambda: {"": {}}
    )
    """Settings by a name that is a part of the cell's; ``config`` among them names the file."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of all runs, as in a YAML file for ``train``, such as ``n_timesteps``; a variant
    overrides them. ``config`` is the YAML file or the name of presets."""
    seeds: Annotated[tuple[Index, ...], Listed, MinLen(1)] = (0,)
    """Seeds of each cell; each gives one run."""
    episodes: Count = 1
    """Episodes that each trained model plays."""
    checkpoint_every: Count = 10_000
    """Environment steps between two checkpoints: the most that is lost if a process dies."""
    resources: Nested[Resources] = Resources()
    """Resources of a run on a cluster: fields of :class:`~sb3_piano.jobs.Resources`."""

    def __post_init__(self) -> None:
        if not (self.pieces or self.envs):
            raise ConfigError("A sweep has neither pieces nor envs: expected at least one.")

    def jobs(self, place: Path) -> list[TrainingJob]:
        """Create the jobs of all runs in the sweep's folder, each called ``<cell>/seed_<n>``.

        Raises:
            ConfigError: If a run's settings are not valid, or two cells have one name.
            UnknownPieceError: If a piece is unknown.
        """
        played: list[tuple[str, str, dict[str, Any]]] = [(env, env, {}) for env in self.envs]
        for piece in map(str, select_pieces(self.pieces) if self.pieces else ()):
            text = os.path.realpath(piece) if is_path(piece) else piece
            played.append((Path(text).stem, GENERAL_ID, {"score": text}))
        found: dict[str, TrainingJob] = {}
        options: Any = {"episodes": self.episodes, "checkpoint_every": self.checkpoint_every}
        grid = itertools.product(self.algos, played, self.variants.items(), self.seeds)
        for algo, (title, env_id, played_with), (variant, changed), seed in grid:
            plain = (re.sub(r"[^\w.-]+", "-", part).strip("-") for part in (algo, title, variant))
            name = f"{'_'.join(filter(None, plain))}/seed_{seed}"
            if name in found:
                raise ConfigError(
                    f"Two runs of the sweep are called {name!r}: expected algorithms, pieces, "
                    "variants and seeds that differ."
                )
            with naming(f"Run {name!r} of the sweep"):
                given = merged(self.settings, changed)
                given = merged(given, {"env_kwargs": played_with, "seed": seed})
                run = load_config(algo, env_id, given.pop("config", None), **given)
            found[name] = TrainingJob(name=name, folder=place / name, config=run, **options)
        return list(found.values())


def load_sweep(file: str | os.PathLike[str]) -> SweepConfig:
    """Load the settings from a YAML file.

    Raises:
        ConfigError: If it cannot be read or a setting is not valid; the message names the file.
    """
    content = read_yaml_mapping(Path(file))
    with naming(f"'{file}'"):
        config = SweepConfig(**content)
    return config


def sweep(
    config: SweepConfig,
    folder: str | os.PathLike[str],
    *,
    on_result: Callable[[Outcome, int, int], object] = lambda outcome, done, total: None,
    **where: Any,
) -> list[Outcome]:
    """Train and evaluate all runs of a grid, or the rest of them; return the outcome of each.

    Each run gets a folder ``<cell>/seed_<n>`` and a line in ``results.csv``. See
    :func:`~sb3_piano.jobs.finish` for finished, stopped and failed runs. Ctrl-C ends the sweep:
    some outcomes then have neither result nor error. The same call resumes it.

    Args:
        config: The grid.
        folder: The sweep's folder: new, empty, or with a sweep of the same settings; cells and
            seeds may have been added.
        on_result: Called with each ended run, the number of ended runs and the number of all runs.
        **where: ``executor``, or ``workers`` and ``ray`` for the one that is opened, see
            :func:`~sb3_piano.jobs.finish`; all its processes see the folder.

    Raises:
        ConfigError: If a setting is not valid, or the cluster cannot be reached.
        RunError: If the folder cannot be used, or has runs of other settings.
    """
    place = shared_folder(folder)
    jobs = config.jobs(place)
    expected = "one command in a folder: --workers for more runs at once, --status for its state."
    with hold(place / LOCK_SUFFIX, f"Sweep '{place}' is being run", expected):
        former = place / _FORMER
        noted = (load_yaml(former.read_text("utf-8")) or {}) if former.is_file() else {}
        for job in jobs:  # an earlier version may have begun it
            if job.name in noted and job.folder.is_dir() and not job.has_begun():
                write_yaml(job.settings_file, noted[job.name])
        if not (former.is_file() or (place / RESULTS).is_file() or is_empty(place)):
            raise RunError(
                f"Folder '{place}' is not empty and no sweep: expected a new or empty one."
            )
        runs = {one.job.name: one for one in status(jobs)}

        def tell(outcome: Outcome, done: int, total: int) -> None:
            runs[outcome.job.name] = outcome
            _write_results(place, list(runs.values()))
            on_result(outcome, done, total)

        _write_results(place, list(runs.values()))
        with contextlib.suppress(KeyboardInterrupt):
            finish(jobs, on_outcome=tell, resources=config.resources, **where)
        return list(runs.values())


def _write_results(place: Path, runs: Sequence[Outcome]) -> None:
    """Write a line for each run with its name, state and metrics."""
    rows: list[dict[str, Any]] = []
    names: dict[str, Any] = {}
    for run in runs:
        cell, _, seed = run.job.name.rpartition("/seed_")
        metrics = (run.result or {}).get("metrics", {})
        steps = (run.job.progress() or (0,))[0]
        row = {"cell": cell, "seed": seed, "state": run.state, "steps": steps}
        rows.append({**row, "reason": run.reason, "folder": run.job.folder, **metrics})
        names |= metrics
    write_csv(place / RESULTS, ("cell", "seed", "state", "steps", *names, "reason", "folder"), rows)
