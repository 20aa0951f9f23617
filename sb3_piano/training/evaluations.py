"""Evaluation of several runs on several pieces."""

from __future__ import annotations

import itertools
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError, SB3PianoError
from sb3_piano.files import write_json
from sb3_piano.music import Score, load_score
from sb3_piano.training.csv_files import write_csv
from sb3_piano.training.evaluate import Evaluation, Seeds, checked_seeds, evaluate

_log = logging.getLogger(__name__)

_CSV_START = ("run", "algo", "piece", "seed", "episode")


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A run that could not be evaluated."""

    run: Path
    """The run's folder."""
    piece: str | None
    """What it should have played; ``None`` for its own piece."""
    reason: str
    """What went wrong."""

    def __str__(self) -> str:
        on_piece = "" if self.piece is None else f" on {self.piece!r}"
        return f"Run '{self.run}' was not evaluated{on_piece}: {self.reason}"


@dataclass(frozen=True, kw_only=True)
class Evaluations:
    """What :func:`evaluate_runs` found."""

    evaluations: tuple[Evaluation, ...]
    """One for each run and piece, in the order they were asked for."""
    failures: tuple[Failure, ...] = ()
    """The runs that could not be evaluated."""
    interrupted: bool = False
    """Whether Ctrl-C ended it early."""

    def write_json(self, path: Path) -> None:
        """Write everything, statistics included."""
        write_json(
            path,
            {
                "interrupted": self.interrupted,
                "evaluations": [evaluation.to_json() for evaluation in self.evaluations],
                "failures": [
                    {"run": str(f.run), "piece": f.piece, "reason": f.reason} for f in self.failures
                ],
            },
        )

    def write_csv(self, path: Path) -> None:
        """Write a row for each episode: run, algorithm, piece, seed, episode, and all metrics.

        Episodes count from 1 on for each seed; a metric that an episode lacks is left empty.
        """
        metrics = dict.fromkeys(name for e in self.evaluations for name in e.summary)
        rows = [row for evaluation in self.evaluations for row in _csv_rows(evaluation)]
        write_csv(path, (*_CSV_START, *metrics), rows)


def evaluate_runs(
    folders: Sequence[str | os.PathLike[str]],
    episodes: int = 1,
    seeds: Seeds = 0,
    *,
    physics: str | None = None,
    scores: Sequence[Score | str | os.PathLike[str]] = (),
    best: str | None = None,
    motion: bool = False,
    on_episode: Callable[[], object] = lambda: None,
) -> Evaluations:
    """Evaluate several runs, each on its own piece or on the given ones.

    What cannot be evaluated does not stop the others. Ctrl-C does, and all that was played until
    then is returned. Files in the runs' folders are those of
    :func:`~sb3_piano.training.evaluate`.

    Args:
        folders: The runs' folders.
        episodes: How many episodes to play from each seed, at least 1.
        seeds: Seeds of the environment, at least 0.
        physics: Name of the physics profile to play on; by default each run's own.
        scores: What to play in place of the runs' own pieces.
        best: Play each run's best model by this metric, such as "f1", in place of the last one.
        motion: Also write how everything moved, which can only be done for the runs' own pieces.
        on_episode: Is called after each episode.

    Raises:
        ConfigError: If a number is out of range, or a run is given twice.
        ScoreError: If a score cannot be read.
    """
    seeds = checked_seeds(seeds)
    if episodes < 1:
        raise ConfigError(f"episodes is {episodes}: expected 1 or more.")
    runs = _distinct(folders)
    pieces: list[Score | None] = [load_score(score) for score in scores]
    found: list[Evaluation] = []
    failures: list[Failure] = []
    interrupted = False
    try:
        for run, piece in itertools.product(runs, pieces or [None]):
            settings = {"physics": physics, "score": piece, "best": best, "motion": motion}
            result = _try(run, episodes, seeds, settings, on_episode)
            if isinstance(result, Failure):
                failures.append(result)
                continue
            found.append(result)
            if result.interrupted:
                interrupted = True
                break
    except KeyboardInterrupt:
        interrupted = True
    return Evaluations(evaluations=tuple(found), failures=tuple(failures), interrupted=interrupted)


def _distinct(folders: Sequence[str | os.PathLike[str]]) -> list[Path]:
    runs = [Path(folder) for folder in folders]
    for run in runs:
        if [other.resolve() for other in runs].count(run.resolve()) > 1:
            raise ConfigError(f"Run '{run}' is given twice: expected each run once.")
    return runs


def _try(
    run: Path,
    episodes: int,
    seeds: Sequence[int],
    settings: Mapping[str, Any],
    on_episode: Callable[[], object],
) -> Evaluation | Failure:
    try:
        return evaluate(run, episodes, seeds, **settings, on_episode=on_episode)
    except SB3PianoError as error:
        reason = str(error)
    except Exception as error:  # a run's own wrappers may fail in any way
        _log.exception("Evaluating run '%s' failed.", run)
        reason = repr(error)
    piece = settings["score"]
    return Failure(run=run, piece=None if piece is None else piece.title, reason=reason)


def _csv_rows(evaluation: Evaluation) -> list[dict[str, Any]]:
    seeds = evaluation.episode_seeds
    return [
        {
            "run": evaluation.run,
            "algo": evaluation.algo,
            "piece": evaluation.piece,
            "seed": seed,
            "episode": seeds[:index].count(seed) + 1,
            **metrics,
        }
        for index, (seed, metrics) in enumerate(zip(seeds, evaluation.episodes, strict=True))
    ]
