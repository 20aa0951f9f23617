"""Jobs of a distillation's executor: record shards of excerpts, and evaluate."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import sb3_piano
from sb3_piano.arrays import Float32Array
from sb3_piano.demonstrations.dataset import Transitions
from sb3_piano.demonstrations.shards import Notes, Play, ShardJob, file_digest, shard_job
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
"""Settings that decide how excerpts are played, besides the rounds' settings."""

JUDGED_BY = ("f1", "onset_f1")
"""Metrics of an evaluation."""


def shard_jobs(
    config: DistillConfig, round_number: int, learner: Path | None, root: Path
) -> list[ShardJob]:
    """Return the jobs of a round, from 0; ``learner`` is the previous round's network file."""
    settings, size = config.to_mapping(), config.shard
    played = [settings[name] for name in _PLAYED_BY]
    rounds = settings["rounds"][: round_number + 1]
    weights = "" if learner is None else file_digest(learner)
    jobs = []
    for number in range(-(-config.rounds[round_number].excerpts // size)):
        name = f"round{round_number}-shard{number:03d}-v0"
        excerpts = config.of_round(round_number)[number * size :][:size]
        metadata = {
            "algorithm_name": config.teacher.name,
            "description": f"Excerpts {excerpts}, with the teacher's actions as labels.",
            "sb3_piano": {"version": sb3_piano.__version__, "distill": settings},
        }
        content = [played, rounds, name, weights]
        playing = functools.partial(_playing, config, round_number, learner)
        jobs.append(shard_job(name, root, content, excerpts, metadata, playing))
    return jobs


@contextlib.contextmanager
def _playing(
    config: DistillConfig, round_number: int, learner: Path | None
) -> Iterator[tuple[HandActions, Play]]:
    """Yield the environment, and a function that plays an excerpt in it.

    Raises:
        ConfigError: If the teacher does not fit, or the learner's file is damaged.
    """
    env = _env(config.playing.physics, "keep")
    with torch_computing(), new_teacher(config.teacher, config.playing, env) as teacher:
        network = None if learner is None else HandModel.load(learner)

        def play(number: int) -> tuple[EpisodeBuffer, Notes]:
            return play_excerpt(config, round_number, number, env, teacher, network)

        yield env, play


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
    """Return a piece's title and a network's metrics; ``None`` if it cannot be played."""
    try:
        found = play_alone(_env(physics, "robot"), score, HandModel.load(learner))
    except (ScoreError, SimulationDivergedError):
        return score.title, None
    return score.title, {name: found[name] for name in JUDGED_BY}


@functools.lru_cache(maxsize=2)
def _env(physics: str, fingering: str) -> HandActions:
    """Return this process's environment, shared by all its jobs."""
    return hands_env(physics, fingering)
