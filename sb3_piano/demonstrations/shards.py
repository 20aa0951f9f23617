"""Shards: data sets of a few episodes each, made by any process, and known to be whole."""

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
"""What is noted about an episode; numbers are also written into the data set."""

Play = Callable[[int], tuple["EpisodeBuffer", Notes]]
"""Plays the episode of a number."""

_VERSIONS = ("gymnasium", "h5py", "minari", "mujoco", "numpy", "stable-baselines3", "torch")


@dataclass(frozen=True, kw_only=True)
class Shard:
    """A data set that is there and whole, as its manifest describes it."""

    name: str
    """Name of the data set."""
    job: str
    """:attr:`ShardJob.digest`."""
    files: Mapping[str, str]
    """SHA-256 of each file, by which damage is found."""
    content: str
    """SHA-256 of the episodes' seeds and arrays in their order, whatever the files are like."""
    versions: Mapping[str, str]
    """Versions of the packages that made it."""
    steps: int
    """Control steps."""
    episodes: tuple[Notes, ...]
    """Notes on each episode, such as ``noise`` and ``f1``."""
    skipped: Mapping[str, str]
    """Why an episode, by its number, could not be played."""

    def open(self, root: Path) -> MinariDataset:
        """Return the data set, in the folder of all.

        Raises:
            ConfigError: If it cannot be read.
        """
        return open_dataset(self.name, root)

    def is_whole(self, root: Path) -> bool:
        """Return whether its files are still as they were written."""
        return self.files == _files(self.name, root)


Playing = Callable[[], AbstractContextManager[tuple[gym.Env[Any, Any], Play]]]
"""Gives the environment that is recorded, and what plays an episode in it."""


@dataclass(frozen=True, kw_only=True)
class ShardJob(Job):
    """Episodes that are to become a data set; :func:`shard_job` makes one.

    What is played is a function of the job alone, not of what its process did before. An episode
    that cannot be played raises ``ScoreError`` or ``SimulationDivergedError``.
    """

    digest: str
    """Checksum of all that decides what the data set holds."""
    numbers: Sequence[int]
    """Numbers of the episodes."""
    metadata: Mapping[str, Any]
    """What the data set notes about itself, in JSON's types."""
    playing: Playing

    @property
    def result_file(self) -> Path:
        """Where it is noted what the data set is; it is written last."""
        return self.folder.with_name(f"{self.name}.json")

    def result(self) -> Mapping[str, Any] | None:
        """Return the manifest of a data set that is there, whole and of the same settings."""
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
    """Return the job of a data set in the folder of all.

    Args:
        name: Name of the data set.
        root: The folder, by a path that all processes have.
        content: All that decides what the data set holds, its name included, in JSON's types.
        numbers: Numbers of the episodes.
        metadata: What the data set notes about itself.
        playing: Gives environment and player; other processes must be able to import it.
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
    """Return the data set of a job if it is there, whole and of the same settings."""
    try:
        shard = read_json(job.result_file, Shard, "it is made again.")
    except RunError:
        return None
    if shard is None or shard.job != job.digest or not shard.is_whole(job.folder.parent):
        return None
    return shard


def _make(job: ShardJob) -> Mapping[str, Any]:
    """Play the episodes of a job and write the data set, in place of any that is there."""
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
    """Return data sets in their order; those that are not there and whole are made.

    Args:
        executor: Makes them.
        jobs: What is to be there.
        tell: Is told how many are done, and of how many.
        **options: Further ones of :func:`~sb3_piano.jobs.finish`.

    Raises:
        Exception: What the first one raised that could not be made, once the others are.
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
    """Return the checksums of a data set's files, of none if it is not there."""
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
