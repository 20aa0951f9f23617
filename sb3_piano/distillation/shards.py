"""Shards: data sets of a few excerpts each, made by any process, and known to be whole."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

import sb3_piano
from sb3_piano.demonstrations.dataset import (
    DatasetWriter,
    Transitions,
    dataset_folder,
    open_dataset,
)
from sb3_piano.distillation.config import DistillConfig
from sb3_piano.distillation.rollout import hands_env, play_alone, play_excerpt
from sb3_piano.distillation.teachers import new_teacher
from sb3_piano.exceptions import RunError, ScoreError, SimulationDivergedError
from sb3_piano.files import read_json, write_json
from sb3_piano.music import Score
from sb3_piano.players import HandModel
from sb3_piano.threads import torch_computing
from sb3_piano.wrappers import HandActions

Float32Array = npt.NDArray[np.float32]

JUDGED_BY = ("f1", "onset_f1")
"""Metrics of an evaluation."""


@dataclass(frozen=True, kw_only=True)
class ShardJob:
    """Excerpts of a round that are to become a data set."""

    config: DistillConfig
    """The settings."""
    round_number: int
    """The round, from 0."""
    number: int
    """The shard's number in the round, from 0."""
    learner: Path | None
    """File of the weights of the round before; none in the first."""
    root: Path
    """The folder of the data sets."""

    @property
    def name(self) -> str:
        """Name of the data set."""
        return f"round{self.round_number}-shard{self.number:03d}-v0"

    @property
    def excerpts(self) -> range:
        """Numbers of the excerpts, counted over all rounds."""
        size = self.config.shard
        return self.config.of_round(self.round_number)[self.number * size :][:size]

    @property
    def manifest_file(self) -> Path:
        """Where it is noted what the data set is; it is written last."""
        return self.root / f"{self.name}.json"

    @property
    def digest(self) -> str:
        """Checksum of all that decides what the data set holds."""
        learner = "" if self.learner is None else _sha256(self.learner)
        content = [self.config.to_mapping(), self.name, learner]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Shard:
    """A data set that is there and whole, as its manifest describes it."""

    name: str
    """Name of the data set."""
    job: str
    """:attr:`ShardJob.digest`."""
    files: Mapping[str, str]
    """Checksum of each file."""
    steps: int
    """Control steps."""
    episodes: tuple[Mapping[str, float], ...]
    """Notes on each excerpt: ``excerpt`` (its number, its seed too), ``noise``, ``f1`` and more."""
    skipped: Mapping[str, str]
    """Why an excerpt, by its number, could not be played."""


def shard_jobs(
    config: DistillConfig, round_number: int, learner: Path | None, root: Path
) -> list[ShardJob]:
    """Return the jobs of a round."""
    count = -(-config.rounds[round_number].excerpts // config.shard)
    return [
        ShardJob(
            config=config, round_number=round_number, number=number, learner=learner, root=root
        )
        for number in range(count)
    ]


def find_shard(job: ShardJob) -> Shard | None:
    """Return the data set of a job if it is there, whole and of the same settings."""
    try:
        shard = read_json(job.manifest_file, Shard, "it is made again.")
    except RunError:
        return None
    if shard is None or shard.job != job.digest or shard.files != _files(job):
        return None
    return shard


def make_shard(job: ShardJob) -> Shard:
    """Play the excerpts of a job and write the data set, in place of any that is there.

    Raises:
        ConfigError: If the teacher does not fit, or the learner's file is damaged.
    """
    config, env = job.config, _env(job.config.playing.physics, "keep")
    episodes, skipped = [], {}
    with (
        torch_computing(),
        new_teacher(config.teacher, config.playing, env) as teacher,
        DatasetWriter(job.name, env, env.spec, overwrite=True, root=job.root) as writer,
    ):
        learner = None if job.learner is None else HandModel.load(job.learner)
        for number in job.excerpts:
            try:
                episode, notes = play_excerpt(
                    config, job.round_number, number, env, teacher, learner
                )
            except (ScoreError, SimulationDivergedError) as error:
                skipped[str(number)] = str(error)
                continue
            writer.add(episode, notes)
            episodes.append(notes)
        job.manifest_file.unlink(missing_ok=True)  # which would be of the data set before
        dataset = writer.finish(
            {
                "algorithm_name": config.teacher.name,
                "description": f"Excerpts {job.excerpts}, with the teacher's actions as labels.",
                "requirements": [f"sb3-piano>={sb3_piano.__version__}"],
                "sb3_piano": {"version": sb3_piano.__version__, "distill": config.to_mapping()},
            }
        )
    shard = Shard(
        name=job.name,
        job=job.digest,
        files=_files(job),
        steps=dataset.total_steps,
        episodes=tuple(episodes),
        skipped=skipped,
    )
    write_json(job.manifest_file, dataclasses.asdict(shard))
    return shard


def read_rows(root: Path, shard: Shard) -> tuple[Float32Array, Float32Array]:
    """Return both hands' rows of a data set: observations (N, n) and labels (N, m).

    Raises:
        ConfigError: If the data set is damaged.
    """
    transitions = Transitions.of(open_dataset(shard.name, root))
    return tuple(  # type: ignore[return-value]
        array.reshape(2 * len(transitions), -1)
        for array in (transitions.observations, transitions.expert_actions)
    )


def judge(physics: str, learner: Path, score: Score) -> tuple[str, Mapping[str, float] | None]:
    """Return a piece's title, and the metrics of a network; none of what cannot be played."""
    try:
        info = play_alone(_env(physics, "robot"), score, HandModel.load(learner))
    except (ScoreError, SimulationDivergedError):
        return score.title, None
    return score.title, {name: float(info[name]) for name in JUDGED_BY}


@functools.lru_cache(maxsize=2)
def _env(physics: str, fingering: str) -> HandActions:
    """Return the environment of this process, for all of its jobs."""
    return hands_env(physics, fingering)


def _files(job: ShardJob) -> dict[str, str]:
    """Return the checksums of a data set's files, of none if it is not there."""
    place = dataset_folder(job.name, job.root)
    return {str(p.relative_to(place)): _sha256(p) for p in sorted(place.rglob("*")) if p.is_file()}


def _sha256(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
