"""Results of evaluations."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sb3_piano.files import write_csv, write_json
from sb3_piano.metrics import Losses
from sb3_piano.players.tree_search import SearchStatistics
from sb3_piano.training.evaluation.statistics import Summary


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Result of :func:`~sb3_piano.training.evaluate`.

    The names of metrics are ``return``, ``length`` (steps) and, for piano environments, those of
    ``sb3_piano.metrics.EPISODE_METRICS`` and ``sb3_piano.envs.RETURN_KEYS``.
    """

    run: Path
    """The run's folder."""
    algo: str
    """Name of the algorithm."""
    piece: str
    """Title of the piece, or the number of pieces; the environment's id if it is no piano."""
    num_timesteps: int
    """Environment steps of the model's training."""
    training_seed: int | None
    """Seed of the training."""
    env_kwargs: Mapping[str, Any]
    """Arguments of the environment."""
    episodes: tuple[Mapping[str, float], ...]
    """Metrics of each episode."""
    episode_seeds: tuple[int, ...]
    """Seed of each episode; episodes of one seed are adjacent, in order."""
    summary: Mapping[str, Summary]
    """Mean, standard deviation and interval of each metric over all episodes; with several pieces,
    over their means."""
    baseline: Mapping[str, float] | None
    """Metrics of an episode with resting hands, with several pieces their means; ``None`` if the
    environment is no piano."""
    performances: tuple[Path | None, ...] = ()
    """MIDI file of each episode, ``None`` if no key was pressed; empty if no files were written, as
    for pieces other than the run's own."""
    losses: Losses | None = None
    """Lost frames of all episodes together; ``None`` if the environment is no piano."""
    tree: SearchStatistics | None = None
    """Statistics of the tree search, if one was used."""
    motions: tuple[Path, ...] = ()
    """Motion file of each episode; empty if none was requested."""
    metrics_file: Path | None = None
    """File in the run's folder with the results of all its pieces; ``None`` if none was
    written."""
    interrupted: bool = False
    """Whether Ctrl-C ended the evaluation before all episodes were played."""
    by_piece: tuple[Evaluation, ...] = ()
    """Evaluation of each piece of a run with several pieces; else empty."""

    @property
    def mean(self) -> dict[str, float]:
        """Mean of each metric, from :attr:`summary`."""
        return {name: summary.mean for name, summary in self.summary.items()}

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each metric, likewise (population; 0 for one episode)."""
        return {name: summary.std for name, summary in self.summary.items()}

    @property
    def has_interval(self) -> bool:
        """Whether any metric varies over the episodes."""
        return any(summary.interval is not None for summary in self.summary.values())

    @property
    def is_repetition(self) -> bool:
        """Whether several episodes are all equal, so that one would suffice.

        A deterministic policy in a deterministic environment plays the same from every seed.
        """
        first, *others = self.episodes
        return bool(others) and all(other == first for other in others)

    def to_json(self) -> dict[str, Any]:
        """Return the evaluation in JSON's types.

        ``mean``, ``std`` and ``interval`` have a value for each metric. An interval is both ends or
        ``None``; ``no_interval`` then has the reason. ``evaluations`` has one per piece of several.
        """

        def own(*names: str) -> dict[str, Any]:
            return {name: getattr(self, name) for name in names}

        summaries = self.summary.items()
        pieces = [evaluation.to_json() for evaluation in self.by_piece]
        return {
            "run": str(self.run),
            **own("algo", "piece", "num_timesteps", "training_seed"),
            "env_kwargs": dict(self.env_kwargs),
            **own("interrupted", "mean", "std"),
            "interval": {name: summary.interval for name, summary in summaries},
            "no_interval": {name: s.no_interval for name, s in summaries if s.no_interval},
            **own("baseline", "episodes", "episode_seeds"),
            "losses": None if self.losses is None else dataclasses.asdict(self.losses),
            "tree": None if self.tree is None else self.tree._asdict(),
            "performances": [None if path is None else path.name for path in self.performances],
            "motions": [path.name for path in self.motions],
            **({"evaluations": pieces} if pieces else {}),
        }


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A failed evaluation of a run, or of a run on one piece."""

    run: Path
    """The run's folder."""
    piece: str | None
    """The piece; ``None`` for the run's own piece or all of its pieces."""
    reason: str
    """Message of the error."""

    def __str__(self) -> str:
        on_piece = "" if self.piece is None else f" on {self.piece!r}"
        return f"Run '{self.run}' was not evaluated{on_piece}: {self.reason}"


@dataclass(frozen=True, kw_only=True)
class Evaluations:
    """Result of :func:`~sb3_piano.training.evaluation.evaluate.evaluate_runs`."""

    evaluations: tuple[Evaluation, ...]
    """One per run and piece, in the order requested."""
    failures: tuple[Failure, ...] = ()
    """Failed runs, or pieces of runs."""
    interrupted: bool = False
    """Whether Ctrl-C ended the evaluations early."""

    def write_json(self, path: Path) -> None:
        """Write all results and statistics."""
        failures = [{**vars(failure), "run": str(failure.run)} for failure in self.failures]
        evaluations = [evaluation.to_json() for evaluation in self.evaluations]
        content = {"interrupted": self.interrupted, "evaluations": evaluations}
        write_json(path, {**content, "failures": failures})

    def write_csv(self, path: Path) -> None:
        """Write one row per episode: run, algorithm, piece, seed, episode and all metrics.

        Episodes are counted from 1 for each seed; missing metrics are left empty.
        """
        metrics = dict.fromkeys(name for e in self.evaluations for name in e.summary)
        rows = [
            {
                "run": found.run,
                "algo": found.algo,
                "piece": found.piece,
                "seed": seed,
                "episode": found.episode_seeds[:index].count(seed) + 1,
                **found.episodes[index],
            }
            for found in self.evaluations
            for index, seed in enumerate(found.episode_seeds)
        ]
        write_csv(path, ("run", "algo", "piece", "seed", "episode", *metrics), rows)
