"""Shards: data sets of a few episodes each, with a manifest that detects damage."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from pydantic import TypeAdapter

import sb3_piano
from sb3_piano.demonstrations.dataset import DatasetWriter, dataset_folder, open_dataset
from sb3_piano.exceptions import RunError, ScoreError, SimulationDivergedError
from sb3_piano.files import read_json
from sb3_piano.jobs import Job, finish, status

if TYPE_CHECKING:
    from minari import MinariDataset
    from minari.data_collector.episode_buffer import EpisodeBuffer

Notes = Mapping[str, float | str]
"""Notes on an episode; numbers are also written into the data set."""

Play = Callable[[int], tuple["EpisodeBuffer", Notes]]
"""Function that plays the episode of a number."""

_VERSIONS = ("gymnasium", "h5py", "minari", "mujoco", "numpy", "stable-baselines3", "torch")


@dataclass(frozen=True, kw_only=True)
class Shard:
    """Manifest of a complete data set."""

    name: str
    """Name of the data set."""
    job: str
    """:attr:`ShardJob.digest`."""
    files: Mapping[str, str]
    """SHA-256 of each file, to detect damage."""
    content: str
    """SHA-256 of the episodes' seeds and arrays in order, independent of the file format."""
    versions: Mapping[str, str]
    """Versions of the packages that wrote it."""
    steps: int
    """Control steps."""
    episodes: tuple[Notes, ...]
    """Notes on each episode, such as ``noise`` and ``f1``."""
    skipped: Mapping[str, str]
    """Reason for each failed episode, by its number."""

    def open(self, root: Path) -> MinariDataset:
        """Open the data set in the folder of all data sets.

        Raises:
            ConfigError: If it cannot be read.
        """
        return open_dataset(self.name, root)

    def is_whole(self, root: Path) -> bool:
        """Return whether the files still have their checksums."""
        return self.files == _files(self.name, root)


Playing = Callable[[], AbstractContextManager[tuple[gym.Env[Any, Any], Play]]]
"""Context manager of the recorded environment and a function that plays an episode."""


@dataclass(frozen=True, kw_only=True)
class ShardJob(Job):
    """Job that records episodes as a data set; :func:`shard_job` makes one.

    The episodes depend on the job alone, not on earlier work of its process. An episode that cannot
    be played raises ``ScoreError`` or ``SimulationDivergedError``.
    """

    digest: str
    """Checksum of all settings that decide the content of the data set."""
    numbers: Sequence[int]
    """Numbers of the episodes."""
    metadata: Mapping[str, Any]
    """Metadata of the data set, in JSON's types."""
    playing: Playing

    @property
    def result_file(self) -> Path:
        """File of the manifest, written last."""
        return self.folder.with_name(f"{self.name}.json")

    def result(self) -> Mapping[str, Any] | None:
        """Return the manifest if the data set is complete and has the same settings."""
        found = find_shard(self)
        return None if found is None else dataclasses.asdict(found)


def shard_job(
    name: str,
    root: Path,
    content: Any,
    numbers: Sequence[int],
    metadata: Mapping[str, Any],
    playing: Playing,
) -> ShardJob:
    """Make the job of a data set in the folder of all data sets.

    Args:
        name: Name of the data set.
        root: The folder, by a path that all processes have.
        content: All settings that decide the content, name included, in JSON's types.
        numbers: Numbers of the episodes.
        metadata: Metadata of the data set.
        playing: Makes environment and player; other processes must be able to import it.
    """
    text = json.dumps(content, sort_keys=True)
    return ShardJob(
        name=name,
        folder=root / name,
        work=_make,
        digest=hashlib.sha256(text.encode()).hexdigest(),
        numbers=numbers,
        metadata=metadata,
        playing=playing,
    )


def find_shard(job: ShardJob) -> Shard | None:
    """Return the data set of a job if it is complete and has the same settings."""
    try:
        shard = read_json(job.result_file, Shard, "it is made again.")
    except RunError:
        return None
    if shard is None or shard.job != job.digest or not shard.is_whole(job.folder.parent):
        return None
    return shard


def _make(job: ShardJob) -> Mapping[str, Any]:
    """Play the episodes of a job and write the data set; replace an existing one."""
    episodes: list[Notes] = []
    skipped, content = {}, hashlib.sha256()
    with (
        job.playing() as (env, play),
        DatasetWriter(job.name, env, env.spec, overwrite=True, root=job.folder.parent) as writer,
    ):
        for number in job.numbers:
            try:
                episode, notes = play(number)
            except (ScoreError, SimulationDivergedError) as error:
                skipped[str(number)] = str(error)
                continue
            writer.add(episode, {n: note for n, note in notes.items() if not isinstance(note, str)})
            episodes.append(notes)
            _add_content(content, episode)
        job.result_file.unlink(missing_ok=True)  # which would be of the data set before
        requirements = [f"sb3-piano>={sb3_piano.__version__}"]
        dataset = writer.finish({"requirements": requirements, **job.metadata})
    made = Shard(
        name=job.name,
        job=job.digest,
        files=_files(job.name, job.folder.parent),
        content=content.hexdigest(),
        versions=_versions(),
        steps=int(dataset.total_steps),
        episodes=tuple(episodes),
        skipped=skipped,
    )
    return dataclasses.asdict(made)


def make_missing(
    executor: Executor | None,
    jobs: Sequence[ShardJob],
    tell: Callable[[int, int], object] = lambda done, total: None,
    **options: Any,
) -> list[Shard]:
    """Make missing or damaged data sets; return all in order.

    Args:
        executor: Executor of the jobs.
        jobs: Jobs of all data sets.
        tell: Called with the numbers of finished and of all jobs.
        **options: Further options of :func:`~sb3_piano.jobs.finish`.

    Raises:
        Exception: The error of the first failed job, after all others have finished.
        KeyboardInterrupt: If it was interrupted.
    """
    known = status(jobs)
    tell(sum(one.result is not None for one in known), len(jobs))
    options = {"known": known, "on_outcome": lambda _, *done: tell(*done), **options}
    outcomes = finish(jobs, executor, **options)
    for outcome in outcomes:
        if outcome.error is not None:
            raise outcome.error
    return [TypeAdapter(Shard).validate_python(outcome.result) for outcome in outcomes]


def file_digest(file: Path) -> str:
    """Return the SHA-256 of a file."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _files(name: str, root: Path) -> dict[str, str]:
    """Return the checksums of a data set's files; empty if it does not exist."""
    place = dataset_folder(name, root)
    files = (path for path in sorted(place.rglob("*")) if path.is_file())
    return {path.relative_to(place).as_posix(): file_digest(path) for path in files}


def _add_content(content: Any, episode: EpisodeBuffer) -> None:
    """Add an episode to a checksum: its seed, then name, type, shape and bytes of each array."""
    arrays = {
        "observations": episode.observations,
        "actions": episode.actions,
        "rewards": episode.rewards,
        "terminations": episode.terminations,
        "truncations": episode.truncations,
        **{f"infos/{name}": array for name, array in sorted((episode.infos or {}).items())},
    }
    content.update(f"seed {episode.seed}".encode())
    for name, values in arrays.items():
        array = np.ascontiguousarray(values)
        content.update(f"{name} {array.dtype.str} {array.shape}".encode())
        content.update(array.tobytes())


def _versions() -> dict[str, str]:
    found = {package: importlib.metadata.version(package) for package in _VERSIONS}
    return {"sb3-piano": sb3_piano.__version__, **found}
