"""Rounds of a distillation: each plays, trains on all that was played so far, and is judged."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

import numpy as np
import torch
from stable_baselines3.common.running_mean_std import RunningMeanStd

from sb3_piano.distillation.config import DistillConfig
from sb3_piano.distillation.network import (
    Float32Array,
    new_policy,
    read_weights,
    regress,
    standardize,
    write_weights,
)
from sb3_piano.distillation.rollout import hands_env
from sb3_piano.distillation.shards import (
    JUDGED_BY,
    EvaluationJob,
    Shard,
    find_shard,
    judge,
    make_shard,
    read_rows,
    shard_jobs,
)
from sb3_piano.distillation.workers import Job, Result, StoppedError, map_jobs
from sb3_piano.exceptions import RunError
from sb3_piano.files import read_json, write_json
from sb3_piano.interrupts import StopRequest
from sb3_piano.music import Score, load_score
from sb3_piano.policies import HandsTD3Policy, hand_weights, load_hand_weights

DATA = "data"
"""Name of the folder of the data sets."""

Progress = Callable[[str, int, int], object]
"""Is called with what is being done, how much of it is done, and of how much."""


@dataclass(frozen=True, kw_only=True)
class RoundResult:
    """Result of a round."""

    number: int
    """The round, from 0."""
    transitions: int
    """Control steps of this round and all before, that the network learnt from."""
    loss: float
    """Mean loss of the last epoch."""
    f1: float
    """Mean F1 of what was played alone."""
    onset_f1: float
    """Mean onset F1 of that."""
    minutes: float
    """Time that the round took since it was begun or resumed."""
    pieces: Mapping[str, Mapping[str, float] | None]
    """Both metrics of each piece by its title; none of one that cannot be played."""
    skipped: Mapping[str, str]
    """Why an excerpt of this round, by its number, could not be played."""


class Rounds:
    """The rounds of a distillation in its folder.

    Args:
        config: The settings.
        place: The folder, by a path that the executor's processes have, too.
        held_out: What is played to judge by.
        executor: Does the jobs.
        request: Ends the work when it is made.
        tell: Tells what is being done.
    """

    def __init__(
        self,
        config: DistillConfig,
        place: Path,
        held_out: Sequence[Score],
        executor: Executor,
        request: StopRequest,
        tell: Progress,
    ) -> None:
        self._config, self._place, self._held_out = config, place, held_out
        self._executor, self._request, self._tell = executor, request, tell
        self._shards: dict[int, list[Shard]] = {}

    def finish(self, number: int) -> RoundResult:
        """Do what is left to do of a round; those before it are done.

        Raises:
            StoppedError: If the request is made.
        """
        started, weights = time.monotonic(), weights_file(self._place, number)
        file = self._place / f"round-{number}.json"
        done = read_json(file, RoundResult, "delete it, and it is made again.")
        if done is not None and weights.is_file():
            return done
        shards = self._play(number)
        if not weights.is_file():
            self._train(number, weights)
        judged = self._judge(number, weights)
        played = [metrics for metrics in judged.values() if metrics is not None]
        if not played:
            raise RunError("Nothing could be played to judge by: expected other evaluation.pieces.")
        facts = read_weights(weights)[1]
        result = RoundResult(
            number=number,
            transitions=facts["transitions"],
            loss=facts["loss"],
            **{name: fmean(metrics[name] for metrics in played) for name in JUDGED_BY},
            minutes=(time.monotonic() - started) / 60,
            pieces=judged,
            skipped={n: why for shard in shards for n, why in shard.skipped.items()},
        )
        write_json(file, dataclasses.asdict(result))
        return result

    def _play(self, number: int) -> list[Shard]:
        """Return the shards of a round, in order; those that are not there are made."""
        if number in self._shards:
            return self._shards[number]
        learner = weights_file(self._place, number - 1) if number > 0 else None
        jobs = shard_jobs(self._config, number, learner, self._place / DATA)
        found = {job.name: find_shard(job) for job in jobs}
        missing = [job for job in jobs if found[job.name] is None]
        text = f"round {number}: playing, shards"
        self._tell(text, len(jobs) - len(missing), len(jobs))
        with self._mapped(make_shard, missing) as made:
            for count, shard in enumerate(made, len(jobs) - len(missing) + 1):
                found[shard.name] = shard
                self._tell(text, count, len(jobs))
        self._shards[number] = [shard for shard in found.values() if shard is not None]
        return self._shards[number]

    def _rows(self, last: int) -> tuple[Float32Array, Float32Array]:
        """Return the rows of all rounds up to one: both hands' observations, and labels."""
        shards = [shard for n in range(last + 1) for shard in self._play(n) if shard.steps > 0]
        if not shards:
            raise RunError("No excerpt could be played: expected another corpus or teacher.")
        rows = observations = labels = None
        first, total = 0, 2 * sum(shard.steps for shard in shards)
        for shard in shards:
            rows = read_rows(self._place / DATA, shard)
            if observations is None or labels is None:  # in one piece: there are gigabytes of it
                observations, labels = (
                    np.empty((total, array.shape[1]), np.float32) for array in rows
                )
            part = slice(first, first + len(rows[0]))
            observations[part], labels[part] = rows
            first = part.stop
        assert observations is not None
        assert labels is not None
        return observations, labels

    def _train(self, number: int, weights: Path) -> None:
        """Train a network on all data so far, and write its weights."""
        config, seed = self._config, [self._config.seed, number]
        observations, labels = self._rows(number)
        torch_seed, shuffle = np.random.SeedSequence(seed).generate_state(2).tolist()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(torch_seed)
            policy = new_policy(config.network, observations.shape[1], labels.shape[1], hands=1)
        self._prepare(policy, number, observations)

        def tell(done: int, updates: int, loss: float) -> None:
            if self._request.made:
                raise StoppedError
            self._tell(f"round {number}: training, loss {loss:.4f}, updates", done, updates)

        with contextlib.closing(hands_env(config.playing.physics)) as env:
            reach = float(np.abs(env.reach).max())
        loss = regress(
            policy, observations, labels, config.learning, reach=reach, seed=shuffle, on_update=tell
        )
        facts = {"loss": loss, "transitions": len(labels) // 2, "reach": reach}
        facts |= dataclasses.asdict(config.network)
        write_weights(policy, weights, facts)

    def _prepare(self, policy: HandsTD3Policy, number: int, observations: Float32Array) -> None:
        """Give a new network the standardisation of the first round, and weights if it is warm."""
        if number == 0:
            statistics = RunningMeanStd(shape=observations.shape[1:])
            for part in np.array_split(observations, max(1, len(observations) // 10_000)):
                statistics.update(part)
            standardize(policy, statistics.mean, np.sqrt(statistics.var))
            return
        kept = read_weights(weights_file(self._place, number - 1))[0]
        if not self._config.learning.warm:
            kept = {name: t for name, t in kept.items() if name.startswith("standardize.")}
        load_hand_weights(policy, {**hand_weights(policy), **kept})

    def _judge(self, number: int, weights: Path) -> dict[str, Mapping[str, float] | None]:
        """Return the metrics of each piece that the network plays alone."""
        text, judged = f"round {number}: held-out pieces", {}
        jobs = [
            EvaluationJob(config=self._config, learner=weights, score=score)
            for score in self._held_out
        ]
        self._tell(text, 0, len(jobs))
        with self._mapped(judge, jobs) as made:
            for title, metrics in made:
                judged[title] = metrics
                self._tell(text, len(judged), len(jobs))
        return {score.title: judged[score.title] for score in self._held_out}

    def _mapped(
        self, function: Callable[[Job], Result], jobs: Sequence[Job]
    ) -> contextlib.closing[Generator[Result, None, None]]:
        """Give the results of jobs; those that have not begun are cancelled with the block."""
        return contextlib.closing(map_jobs(self._executor, function, jobs, self._request))


def held_out_pieces(config: DistillConfig) -> list[Score]:
    """Return what is played to judge by.

    Raises:
        UnknownPieceError: If there is no piece of a name.
    """
    settings = config.evaluation
    count = settings.excerpts
    fresh = replace(config.corpus, seed=config.corpus.seed + 1, n=max(count, 1))
    excerpts = [fresh[index] for index in range(count)]
    pieces = [
        replace(load_score(name).excerpt(0.0, settings.duration), title=name)
        for name in settings.pieces
    ]
    return [*excerpts, *pieces]


def weights_file(place: Path, number: int) -> Path:
    """Return where the weights of a round are."""
    return place / f"round-{number}.safetensors"
