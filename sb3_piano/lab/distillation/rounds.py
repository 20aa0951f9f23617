"""Rounds of a distillation: play excerpts, train on all data so far, evaluate."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.running_mean_std import RunningMeanStd

from sb3_piano.demonstrations.cloning import check_spaces
from sb3_piano.demonstrations.corpus import RecordedCorpus
from sb3_piano.demonstrations.shards import Shard, make_missing
from sb3_piano.demonstrations.streaming import Rows, ShuffledRows
from sb3_piano.exceptions import RunError
from sb3_piano.interrupts import StopRequest
from sb3_piano.jobs import Job, map_jobs
from sb3_piano.lab.distillation.config import DistillConfig
from sb3_piano.lab.distillation.network import new_policy, regress, standardize
from sb3_piano.lab.distillation.rollout import hands_env
from sb3_piano.lab.distillation.shards import (
    JUDGED_BY,
    judge,
    read_rows,
    shard_jobs,
)
from sb3_piano.music import Score, load_score
from sb3_piano.music.selection import unique_titles
from sb3_piano.players import HandModel
from sb3_piano.policies import HandsTD3Policy, hand_weights, load_hand_weights

DATA = "data"
"""Name of the data sets' folder."""

Progress = Callable[[str, int, int], object]
"""Called with the current work, the amount done and the total."""

Make = Callable[[Path], Mapping[str, str]]
"""Writes a network's file if it is missing; returns the reasons of skipped excerpts."""


@dataclass(frozen=True, kw_only=True)
class RoundResult:
    """Result of a round, or of an improvement after the last one."""

    name: str
    """``round-N`` or ``improved-N``, N from 0; also the name of the files."""
    transitions: int
    """Control steps of training data, of this round and all before."""
    loss: float | None
    """Mean loss of the last epoch; ``None`` for an improvement."""
    f1: float
    """Mean F1 of the evaluation."""
    onset_f1: float
    """Mean onset F1 of the evaluation."""
    minutes: float
    """Time of the round since its start or last resumption, min."""
    pieces: Mapping[str, Mapping[str, float] | None]
    """Both metrics of each piece by title; ``None`` for an unplayable piece."""
    skipped: Mapping[str, str]
    """Reason of each skipped excerpt of this round, by its number."""


@dataclass(frozen=True, kw_only=True)
class NetworkJob(Job):
    """Job that makes and evaluates a network, in a round or an improvement.

    Its files are beside its folder; only an improvement has a folder.
    """

    make: Make

    @property
    def weights(self) -> Path:
        """The network's file."""
        return weights_file(self.folder.parent, self.name)

    @property
    def result_file(self) -> Path:
        """The file of its :class:`RoundResult`."""
        return self.folder.with_name(f"{self.name}.json")

    def result(self) -> Mapping[str, Any] | None:
        """Return its :class:`RoundResult` as a mapping; ``None`` without the network."""
        return super().result() if self.weights.is_file() else None


class Rounds:
    """The rounds of a distillation in its folder.

    Args:
        config: The settings.
        place: The folder, by a path valid in the executor's processes.
        held_out: Scores of the evaluation.
        executor: Executor of the jobs.
        request: Request to end the work early.
        tell: Called with the progress.
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
        self._recorded = recorded_of(config)

    def job(self, number: int, name: str, make: Make | None = None) -> NetworkJob:
        """Return the job of a network; by default the job of a round."""
        make = make or partial(self._train, number)
        return NetworkJob(name=name, folder=self._place / name, work=self._judged, make=make)

    def _judged(self, job: NetworkJob) -> Mapping[str, Any]:
        """Make a network and evaluate it; return the :class:`RoundResult` as a mapping."""
        started = time.monotonic()
        skipped = job.make(job.weights)
        pieces = self._judge(job.name, job.weights)
        played = [metrics for metrics in pieces.values() if metrics is not None]
        if not played:
            raise RunError("No evaluation piece could be played: expected other evaluation.pieces.")
        facts = HandModel.load(job.weights).facts
        result = RoundResult(
            name=job.name,
            transitions=facts.num_timesteps,
            loss=float(facts.about["loss"]) if "loss" in facts.about else None,
            **{metric: fmean(metrics[metric] for metrics in played) for metric in JUDGED_BY},
            minutes=(time.monotonic() - started) / 60,
            pieces=pieces,
            skipped=skipped,
        )
        return dataclasses.asdict(result)

    def _play(self, number: int) -> list[Shard]:
        """Return the shards of a round, in order; record the missing ones."""
        if number in self._shards:
            return self._shards[number]
        if number == 0 and self._recorded is not None:
            return list(self._recorded.shards)
        learner = weights_file(self._place, round_name(number - 1)) if number > 0 else None
        jobs = shard_jobs(self._config, number, learner, self._place / DATA)
        text = f"{round_name(number)}: playing, shards"
        self._shards[number] = make_missing(self._executor, jobs, partial(self._tell, text))
        return self._shards[number]

    def _rows(self, last: int) -> ShuffledRows:
        """Return the rows of all rounds up to ``last``: both hands' observations and labels."""
        played = [(n, shard) for n in range(last + 1) for shard in self._play(n) if shard.steps > 0]
        if not played:
            raise RunError("No excerpt could be played: expected another corpus or teacher.")
        reads = [partial(self._read, n, shard) for n, shard in played]
        return ShuffledRows(reads, [2 * shard.steps for _, shard in played], self._config.buffer)

    def _read(self, number: int, shard: Shard) -> Rows:
        """Read the rows of a round's data set, from the recorded corpus if it has it."""
        if number == 0 and self._recorded is not None:
            return read_rows(self._recorded.dataset(shard))
        return read_rows(shard.open(self._place / DATA))

    def _train(self, number: int, weights: Path) -> Mapping[str, str]:
        """Train a network on all data so far, unless it exists; return skipped excerpts."""
        skipped = {n: why for shard in self._play(number) for n, why in shard.skipped.items()}
        if weights.is_file():
            return skipped
        config, name = self._config, round_name(number)
        rows = self._rows(number)
        inputs, actions = (array.shape[1] for array in next(rows.parts()))
        seed = np.random.SeedSequence([config.seed, number])
        torch_seed, shuffle = seed.generate_state(2).tolist()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(torch_seed)
            policy = new_policy(config.network, inputs, actions)
        self._prepare(policy, number, rows)

        def tell(done: int, updates: int, loss: float) -> None:
            if self._request.made:
                raise KeyboardInterrupt
            self._tell(f"{name}: training, loss {loss:.4f}, updates", done, updates)

        with contextlib.closing(hands_env(config.playing.physics)) as env:
            reach = float(np.abs(env.reach).max())
            loss = regress(
                policy,
                rows,
                config.rounds[number],
                reach=reach,
                seed=shuffle,
                on_update=tell,
            )
            HandModel.of(policy, env, len(rows) // 2, loss=repr(loss)).save(weights)
        return skipped

    def _prepare(self, policy: HandsTD3Policy, number: int, rows: ShuffledRows) -> None:
        """Set a new network's standardisation from the first round, and its weights if warm."""
        if number == 0:
            statistics: RunningMeanStd | None = None
            for observations, _ in rows.parts():
                statistics = statistics or RunningMeanStd(shape=observations.shape[1:])
                statistics.update(observations)
            assert statistics is not None, "there is a part"
            standardize(policy, statistics.mean, np.sqrt(statistics.var))
            return
        before = HandModel.load(weights_file(self._place, round_name(number - 1))).tensors
        warm = self._config.rounds[number].warm
        kept = {
            name: torch.from_numpy(tensor)
            for name, tensor in before.items()
            if warm or name.startswith("standardize.")
        }
        load_hand_weights(policy, {**hand_weights(policy), **kept})

    def _judge(self, name: str, weights: Path) -> dict[str, Mapping[str, float] | None]:
        """Evaluate the network alone on each held-out piece; return the metrics by title."""
        text, found = f"{name}: held-out pieces", {}
        total = len(self._held_out)
        self._tell(text, 0, total)
        job = partial(judge, self._config.evaluation.physics, weights)
        with self._mapped(job, self._held_out) as made:
            for title, metrics in made:
                found[title] = metrics
                self._tell(text, len(found), total)
        return {score.title: found[score.title] for score in self._held_out}

    def _mapped(
        self, function: Callable[[Any], Any], jobs: Sequence[Any]
    ) -> contextlib.closing[Generator[Any, None, None]]:
        """Yield the results of jobs; pending jobs are cancelled at the end of the block."""
        return contextlib.closing(map_jobs(self._executor, function, jobs, self._request))


def held_out_pieces(config: DistillConfig) -> list[Score]:
    """Return the scores of the evaluation.

    Raises:
        UnknownPieceError: If there is no piece of a name.
    """
    settings = config.evaluation
    count, end = settings.excerpts, settings.duration or math.inf
    fresh = replace(config.corpus, seed=config.corpus.seed + 1, n=max(count, 1))
    pieces = [replace(load_score(name).excerpt(0.0, end), title=name) for name in settings.pieces]
    found = [*(fresh[index] for index in range(count)), *pieces]
    titles = unique_titles(score.title for score in found)  # other music may have the same title
    return [replace(score, title=title) for score, title in zip(found, titles, strict=True)]


def recorded_of(config: DistillConfig) -> RecordedCorpus | None:
    """Open the corpus that replaces the first round's data, if one is given.

    Raises:
        ConfigError: If there is none in the folder, or it was not recorded by hand.
    """
    if config.recorded is None:
        return None
    corpus = RecordedCorpus.open(config.recorded)
    with contextlib.closing(hands_env(config.playing.physics)) as env:
        dataset = corpus.dataset(corpus.shards[0])
        check_spaces(dataset, env.observation_space, env.action_space)
    return corpus


def round_name(number: int) -> str:
    """Return the name of a round and its files."""
    return f"round-{number}"


def weights_file(place: Path, name: str) -> Path:
    """Return the network's file of a round or an improvement."""
    return place / f"{name}.safetensors"
