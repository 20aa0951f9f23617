"""Rounds of playing, training and judging: from a planned pianist to a network that reads."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shlex
import shutil
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

import numpy as np
import torch
import yaml
from stable_baselines3.common.running_mean_std import RunningMeanStd

from sb3_piano.demonstrations.dataset import require_minari
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
from sb3_piano.distillation.teachers import new_teacher
from sb3_piano.distillation.workers import Job, Result, StoppedError, map_jobs, process_pool
from sb3_piano.exceptions import RunError
from sb3_piano.files import read_json, write_csv, write_json, write_text
from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.music import Score, load_score
from sb3_piano.policies import hand_weights, load_hand_weights
from sb3_piano.threads import torch_threads
from sb3_piano.training.runs.folder import provenance, unwritable

_CONFIG, _PROVENANCE, _DATA, _TABLE = "config.yml", "run.yml", "data", "rounds.csv"

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


@dataclass(frozen=True, kw_only=True)
class DistillResult:
    """Result of :func:`distill`."""

    folder: Path
    """Folder of all files."""
    rounds: tuple[RoundResult, ...]
    """The rounds that are done."""
    weights: Path | None
    """File of the last round's weights, of one hand's network, if a round is done."""
    interrupted: bool = False
    """Whether Ctrl-C or SIGTERM ended it early."""


def distill(
    config: DistillConfig | None,
    folder: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    num_threads: int | None = None,
    on_progress: Progress = lambda text, done, total: None,
    on_round: Callable[[RoundResult], object] = lambda result: None,
) -> DistillResult:
    """Make a policy that plays any piece, out of a teacher's labels in the states it comes into.

    In each round excerpts are played, by the teacher and, from the second round on, by the network
    of the round before, while the teacher says what would be right (DAgger, Ross et al. 2011); then
    a network is trained on all rounds' data and plays held-out music alone.

    A folder in which a distillation was begun is gone on with: what is whole is kept, and the
    result is that of one which never stopped. Ctrl-C or SIGTERM ends it; at most the training of a
    round, and the shard that each worker is at, are then lost.

    ===================== ========================================================================
    ``config.yml``        the settings
    ``run.yml``           command line, versions of packages, time
    ``data/``             Minari data sets of the rounds, and a manifest of each
    ``round-N.safetensors`` weights of one hand's network after round N, from 0
    ``round-N.json``      the round's :class:`RoundResult`; ``rounds.csv`` has a line of each
    ===================== ========================================================================

    Args:
        config: The settings; ``None`` for those of a folder that is gone on with.
        folder: Where to: a new or empty folder, or one to go on with.
        executor: Plays the excerpts, where it sees the folder by the same path; by default a pool
            of processes of this machine.
        workers: Processes of that pool; by default one for each usable core.
        num_threads: Threads of torch for the training; see :func:`sb3_piano.threads.torch_threads`.
        on_progress: Tells what is being done.
        on_round: Is called with the result of each round, also of those done before.

    Raises:
        ConfigError: If a setting is not valid, or the teacher does not fit.
        RunError: If the folder cannot be used, or has other settings.
        UnknownPieceError: If there is no piece to judge by of a given name.
        ImportError: If Minari is not installed.
    """
    require_minari()
    place = Path(folder)
    if config is None:
        config = _settings_of(place)
    held_out = _held_out(config)
    with contextlib.closing(hands_env(config.playing.physics)) as env:
        with new_teacher(config.teacher, config.playing, env):
            pass  # what is wrong with it is better told now than by a worker
        hands_env(config.evaluation.physics).close()
    rounds: list[RoundResult] = []
    interrupted = False
    with _owned(place), torch_threads(num_threads), stop_on_signal() as request:
        _begin(place, config)
        pool = process_pool(workers) if executor is None else contextlib.nullcontext(executor)
        with pool as chosen, _broken_told(place):
            work = _Work(config, place.absolute(), held_out, chosen, request, on_progress)
            try:
                for number in range(len(config.rounds)):
                    rounds.append(work.round(number))
                    _write_table(place, rounds)
                    on_round(rounds[-1])
            except (StoppedError, KeyboardInterrupt):
                interrupted = True
    weights = _weights_file(place, len(rounds) - 1) if rounds else None
    return DistillResult(
        folder=place, rounds=tuple(rounds), weights=weights, interrupted=interrupted
    )


class _Work:
    """The rounds of a distillation in its folder."""

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

    def round(self, number: int) -> RoundResult:
        """Do what is left to do of a round."""
        started, weights = time.monotonic(), _weights_file(self._place, number)
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
        learner = _weights_file(self._place, number - 1) if number > 0 else None
        jobs = shard_jobs(self._config, number, learner, self._place / _DATA)
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
            rows = read_rows(self._place / _DATA, shard)
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
        config, seed = self._config, [self._config.seed, number]
        observations, labels = self._rows(number)
        torch_seed, shuffle = np.random.SeedSequence(seed).generate_state(2).tolist()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(torch_seed)
            policy = new_policy(config.network, observations.shape[1], labels.shape[1], hands=1)
        if number == 0:
            statistics = RunningMeanStd(shape=observations.shape[1:])
            for part in np.array_split(observations, max(1, len(observations) // 10_000)):
                statistics.update(part)
            standardize(policy, statistics.mean, np.sqrt(statistics.var))
        else:
            kept = read_weights(_weights_file(self._place, number - 1))[0]
            if not config.learning.warm:
                kept = {name: t for name, t in kept.items() if name.startswith("standardize.")}
            load_hand_weights(policy, {**hand_weights(policy), **kept})

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


def _held_out(config: DistillConfig) -> list[Score]:
    """Return what is played to judge by."""
    settings = config.evaluation
    count = settings.excerpts
    fresh = replace(config.corpus, seed=config.corpus.seed + 1, n=max(count, 1))
    excerpts = [fresh[index] for index in range(count)]
    pieces = [
        replace(load_score(name).excerpt(0.0, settings.duration), title=name)
        for name in settings.pieces
    ]
    return [*excerpts, *pieces]


def _weights_file(place: Path, number: int) -> Path:
    return place / f"round-{number}.safetensors"


def _settings_of(place: Path) -> DistillConfig:
    """Return the settings of a distillation that was begun."""
    file = place / _CONFIG
    if not file.is_file():
        raise RunError(
            f"There is no distillation in '{place}', it has no {_CONFIG}: expected a folder that "
            "'sb3-piano distill' made."
        )
    return DistillConfig.from_yaml(file)


def _begin(place: Path, config: DistillConfig) -> None:
    """Write the settings into a new folder; check them against those of one to go on with."""
    data, file = place / _DATA, place / _CONFIG
    if file.is_file():
        theirs, ours = _settings_of(place).to_mapping(), config.to_mapping()
        for name, value in ours.items():
            if theirs[name] != value:
                raise RunError(
                    f"The distillation in '{place}' has {name} {theirs[name]}, not {value}: "
                    "expected the same settings, or another folder."
                )
        for left in data.glob(".recording-*"):  # of a worker that was killed
            shutil.rmtree(left, ignore_errors=True)
        return
    if any(found.name != LOCK_SUFFIX for found in place.iterdir()):
        raise RunError(f"Folder '{place}' is not empty: expected a new or empty one.")
    try:
        data.mkdir()
        notes = yaml.safe_dump(provenance(config.seed), sort_keys=False)
        write_text(place / _PROVENANCE, notes)
        write_text(file, yaml.safe_dump(config.to_mapping(), sort_keys=False))
    except OSError as error:
        raise unwritable(place, error) from error


def _write_table(place: Path, rounds: Sequence[RoundResult]) -> None:
    columns = ("number", "transitions", "loss", *JUDGED_BY, "minutes")
    rows = [{name: getattr(result, name) for name in columns} for result in rounds]
    write_csv(place / _TABLE, columns, rows)


@contextlib.contextmanager
def _owned(place: Path) -> Iterator[None]:
    """Keep other processes from working in a folder."""

    def busy(owner: str) -> RunError:
        return RunError(
            f"'{place}' is being worked in by {owner}: expected one distillation in a folder."
        )

    with hold(place / LOCK_SUFFIX, busy):
        yield


@contextlib.contextmanager
def _broken_told(place: Path) -> Iterator[None]:
    """Say how to go on when a worker was killed, as by a machine without memory."""
    try:
        yield
    except BrokenExecutor as error:
        raise RunError(
            f"A worker ended before its work was done, as happens without memory: {error} What is "
            f"whole is kept; go on, with fewer workers if need be: {go_on(place)}"
        ) from error


def go_on(place: Path) -> str:
    """Return the command that goes on with a folder."""
    return f"sb3-piano distill --resume {shlex.quote(str(place))}"
