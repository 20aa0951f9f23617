"""What the executor does in a distillation: shards of played excerpts, and judging."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sb3_piano
from sb3_piano.arrays import Float32Array
from sb3_piano.demonstrations.dataset import Transitions
from sb3_piano.demonstrations.shards import Notes, Play, ShardJob, file_digest
from sb3_piano.exceptions import ScoreError, SimulationDivergedError
from sb3_piano.lab.distillation.config import DistillConfig
from sb3_piano.lab.distillation.rollout import hands_env, play_alone, play_excerpt
from sb3_piano.lab.distillation.teachers import new_teacher
from sb3_piano.music import Score
from sb3_piano.players import HandModel
from sb3_piano.threads import torch_computing
from sb3_piano.wrappers import HandActions

if TYPE_CHECKING:
    from minari import MinariDataset
    from minari.data_collector.episode_buffer import EpisodeBuffer


_PLAYED_BY = ("corpus", "playing", "teacher", "shard", "seed")
"""Settings that decide how excerpts are played, beside those of the rounds."""

JUDGED_BY = ("f1", "onset_f1")
"""Metrics of an evaluation."""


@dataclass(frozen=True, kw_only=True)
class RoundJob(ShardJob):
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

    @property
    def name(self) -> str:
        """Name of the data set."""
        return f"round{self.round_number}-shard{self.number:03d}-v0"

    @property
    def numbers(self) -> range:
        """Numbers of the excerpts, counted over all rounds."""
        size = self.config.shard
        return self.config.of_round(self.round_number)[self.number * size :][:size]

    @property
    def digest(self) -> str:
        """Checksum of the settings up to this round, the data set's name, the learner's weights."""
        learner = "" if self.learner is None else file_digest(self.learner)
        settings = self.config.to_mapping()
        played = [settings[name] for name in _PLAYED_BY]
        rounds = settings["rounds"][: self.round_number + 1]
        content = [played, rounds, self.name, learner]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def metadata(self) -> dict[str, Any]:
        """Teacher and settings."""
        return {
            "algorithm_name": self.config.teacher.name,
            "description": f"Excerpts {self.numbers}, with the teacher's actions as labels.",
            "sb3_piano": {"version": sb3_piano.__version__, "distill": self.config.to_mapping()},
        }

    @contextlib.contextmanager
    def playing(self) -> Iterator[tuple[HandActions, Play]]:
        """Give the environment, and what plays an excerpt in it.

        Raises:
            ConfigError: If the teacher does not fit, or the learner's file is damaged.
        """
        config, env = self.config, _env(self.config.playing.physics, "keep")
        with torch_computing(), new_teacher(config.teacher, config.playing, env) as teacher:
            learner = None if self.learner is None else HandModel.load(self.learner)

            def play(number: int) -> tuple[EpisodeBuffer, Notes]:
                return play_excerpt(config, self.round_number, number, env, teacher, learner)

            yield env, play


def shard_jobs(
    config: DistillConfig, round_number: int, learner: Path | None, root: Path
) -> list[RoundJob]:
    """Return the jobs of a round."""
    count = -(-config.rounds[round_number].excerpts // config.shard)
    return [
        RoundJob(
            config=config, round_number=round_number, number=number, learner=learner, root=root
        )
        for number in range(count)
    ]


def read_rows(dataset: MinariDataset) -> tuple[Float32Array, Float32Array]:
    """Return both hands' rows of a data set: observations (N, n) and labels (N, m).

    Raises:
        ConfigError: If the data set is damaged.
    """
    transitions = Transitions.of(dataset)
    return tuple(  # type: ignore[return-value]
        array.reshape(2 * len(transitions), -1)
        for array in (transitions.observations, transitions.expert_actions)
    )


def judge(physics: str, learner: Path, score: Score) -> tuple[str, Mapping[str, float] | None]:
    """Return a piece's title, and the metrics of a network; none of what cannot be played."""
    try:
        found = play_alone(_env(physics, "robot"), score, HandModel.load(learner))
    except (ScoreError, SimulationDivergedError):
        return score.title, None
    return score.title, {name: found[name] for name in JUDGED_BY}


@functools.lru_cache(maxsize=2)
def _env(physics: str, fingering: str) -> HandActions:
    """Return the environment of this process, for all of its jobs."""
    return hands_env(physics, fingering)
