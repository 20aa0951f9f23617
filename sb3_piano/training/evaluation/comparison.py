"""Paired comparison of two sets of evaluations."""

from __future__ import annotations

import math
import os
import shlex
import statistics
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator

from sb3_piano.envs import PianoEnvConfig
from sb3_piano.exceptions import RunError
from sb3_piano.files import read_json, write_atomically, write_csv
from sb3_piano.metrics.episode import has_value
from sb3_piano.settings import checked, refuse_unknown
from sb3_piano.take import SUFFIX, Take
from sb3_piano.training.evaluation.difference_plot import difference_plot, picture_format
from sb3_piano.training.evaluation.statistics import (
    SignedRankTest,
    Summary,
    signed_rank_test,
    summarize,
)
from sb3_piano.training.runs.folder import RunFolder

MAIN_METRICS = ("f1", "onset_f1", "non_silent_f1", "return", "normalized_return")
"""Metrics compared, and shown for several runs, by default."""

PAIRINGS = ("piece", "seed", "training-seed")
"""Kinds of pairs: by piece, or by seed of the evaluation or of the training, for each piece."""

# Means of equal values may differ in their last digits; smaller differences count as 0.
_EQUAL = 1e-12


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Values of A and B on one task, each a mean over all its episodes."""

    piece: str
    """Piece that was played."""
    seed: int | None
    """Seed of the evaluation or training, if it defines the pair."""
    a: float
    """Value of A."""
    b: float
    """Value of B."""

    @property
    def name(self) -> str:
        """The piece, and the seed if there is one."""
        return _name(self.piece, self.seed)

    @property
    def difference(self) -> float:
        """Value of B minus value of A."""
        return 0.0 if math.isclose(self.a, self.b, rel_tol=_EQUAL) else self.b - self.a

    def to_json(self) -> dict[str, Any]:
        """Return all of it in JSON's types."""
        return {**vars(self), "difference": self.difference}


@dataclass(frozen=True, kw_only=True)
class MetricComparison:
    """A metric of A and B over all pairs."""

    metric: str
    """Name of the metric."""
    pairs: tuple[Pair, ...]
    """The pairs, by piece and seed."""
    difference: Summary
    """Mean of the differences B - A, with its interval."""
    test: SignedRankTest
    """Signed-rank test of the differences."""

    @property
    def mean_a(self) -> float:
        """Mean of A over the pairs."""
        return statistics.fmean(pair.a for pair in self.pairs)

    @property
    def mean_b(self) -> float:
        """Mean of B over the pairs."""
        return statistics.fmean(pair.b for pair in self.pairs)

    @property
    def n_a_below_b(self) -> int:
        """Number of pairs in which A is below B."""
        return sum(pair.difference > 0 for pair in self.pairs)

    @property
    def n_a_not_above_b(self) -> int:
        """Number of pairs in which A is below or equal to B."""
        return sum(pair.difference >= 0 for pair in self.pairs)

    def to_json(self) -> dict[str, Any]:
        """Return all of it in JSON's types."""
        return {
            "pairs": [pair.to_json() for pair in self.pairs],
            "mean_a": self.mean_a,
            "mean_b": self.mean_b,
            "mean_difference": self.difference.mean,
            "interval": self.difference.interval,
            "no_interval": self.difference.no_interval,
            "n_a_below_b": self.n_a_below_b,
            "n_a_not_above_b": self.n_a_not_above_b,
            "n_pairs_that_differ": self.test.n,
            "wilcoxon_p": self.test.p,
            "least_p": self.test.least_p,
            "no_test": self.test.no_test,
        }


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Result of :func:`compare`."""

    a: str
    """Path of A's evaluations."""
    b: str
    """Path of B's evaluations."""
    by: str
    """Kind of the pairs, see :func:`compare`."""
    physics_a: tuple[str, ...]
    """Names of A's physics profiles; expected to be one."""
    physics_b: tuple[str, ...]
    """Names of B's physics profiles; expected to be the same as A's."""
    only_in_a: tuple[str, ...]
    """Pieces, or pieces with seeds, that only A has; they are left out."""
    only_in_b: tuple[str, ...]
    """Pieces, or pieces with seeds, that only B has."""
    metrics: tuple[MetricComparison, ...]
    """The comparison of each metric."""

    def to_json(self) -> dict[str, Any]:
        """Return all of it in JSON's types."""
        return {**vars(self), "metrics": {found.metric: found.to_json() for found in self.metrics}}

    def write_csv(self, path: Path) -> None:
        """Write one row per metric and pair."""
        rows = [{"metric": m.metric, **pair.to_json()} for m in self.metrics for pair in m.pairs]
        write_csv(path, ("metric", "piece", "seed", "a", "b", "difference"), rows)

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Write :func:`difference_plot` atomically, in the format of the suffix.

        Raises:
            ConfigError: If ``path`` does not end in .png, .svg or .pdf.
        """
        path = Path(path)
        kind = picture_format(path)
        figure = difference_plot(self)
        write_atomically(path, lambda file: figure.savefig(file, format=kind, dpi=120))


def compare(
    a: str | os.PathLike[str],
    b: str | os.PathLike[str],
    metrics: Sequence[str] | None = None,
    *,
    by: str = "piece",
) -> Comparison:
    """Compare the evaluations of two runs, or of two sets of runs, on the same pieces.

    Difficulty varies much more between pieces than performance between methods. Differences within
    each piece remove it, as in the evaluation of the curriculum paper.

    Args:
        a: Evaluations: a JSON file, the folder of an evaluated run, or a folder of such runs.
            Episodes of one piece are pooled, also over several runs.
        b: As ``a``; differences are B - A.
        metrics: Names of the metrics; by default those of :data:`MAIN_METRICS` that both have.
        by: "piece" pairs the means over all episodes of a piece, "seed" the means over the episodes
            of one evaluation seed of a piece, "training-seed" the means over runs with one training
            seed. Seeds of one piece are no independent evidence for other pieces.

    Raises:
        ConfigError: If ``by`` or a metric is unknown.
        RunError: If there is no evaluation, it is damaged, or the two have no pair in common.

    Source:
        Demsar, Statistical Comparisons of Classifiers over Multiple Data Sets (2006): one pair for
        each task, compared by the signed-rank test.
    """
    checked("by", by, Literal[PAIRINGS])
    tasks_a, tasks_b = _tasks(a, by), _tasks(b, by)
    common = [task for task in tasks_a if task in tasks_b]
    if not common:
        raise RunError(
            f"'{a}' and '{b}' have no {by} in common: expected evaluations of the same. The former "
            f"has {'; '.join(_names(tasks_a))}; the latter has {'; '.join(_names(tasks_b))}."
        )
    paired = [(task, tasks_a[task], tasks_b[task]) for task in common]
    return Comparison(
        a=str(a),
        b=str(b),
        by=by,
        metrics=tuple(_compared(name, paired) for name in _chosen(metrics, paired)),
        physics_a=tuple(sorted(set().union(*(side.physics for _, side, _ in paired)))),
        physics_b=tuple(sorted(set().union(*(side.physics for _, _, side in paired)))),
        only_in_a=_names(task for task in tasks_a if task not in common),
        only_in_b=_names(task for task in tasks_b if task not in common),
    )


_Task = tuple[str, int | None]  # piece and seed


@dataclass
class _Played:
    """The episodes of A or B on one task."""

    episodes: list[Mapping[str, float]] = field(default_factory=list)
    physics: set[str] = field(default_factory=set)

    def mean(self, metric: str) -> float | None:
        """Return the mean over episodes; ``None`` without a value: timing needs a hit."""
        values = [metrics[metric] for metrics in self.episodes if has_value(metric, metrics)]
        return float(np.mean(values)) if values else None


_Paired = Sequence[tuple[_Task, _Played, _Played]]


def _tasks(source: str | os.PathLike[str], by: str) -> dict[_Task, _Played]:
    tasks: dict[_Task, _Played] = defaultdict(_Played)
    for saved in read_episodes(source):
        if by == "training-seed" and saved.training_seed is None:
            raise RunError(
                f"The evaluation of {saved.piece} in '{source}' does not tell the training's seed: "
                "expected one that 'sb3-piano evaluate' of this version wrote."
            )
        for seed, metrics in zip(saved.episode_seeds, saved.episodes, strict=True):
            paired = {"piece": None, "seed": seed, "training-seed": saved.training_seed}[by]
            played = tasks[saved.piece, paired]
            played.episodes.append(metrics)
            played.physics.add(str(saved.env_kwargs.get("physics", PianoEnvConfig.physics)))
    return tasks


def _chosen(metrics: Sequence[str] | None, paired: _Paired) -> list[str]:
    """Return the requested metrics, each once, or the available main ones."""
    episodes = [metrics for _, a, b in paired for metrics in (*a.episodes, *b.episodes)]
    known = [name for name in episodes[0] if all(name in metrics for metrics in episodes)]
    if metrics is None:
        return [name for name in MAIN_METRICS if name in known] or known
    refuse_unknown(metrics, known, "metric")
    return list(dict.fromkeys(metrics))


def _compared(metric: str, paired: _Paired) -> MetricComparison:
    means = [(task, a.mean(metric), b.mean(metric)) for task, a, b in paired]
    pairs = tuple(
        Pair(piece=piece, seed=seed, a=a, b=b)
        for (piece, seed), a, b in means
        if a is not None and b is not None
    )
    if not pairs:
        raise RunError(
            f"{metric} has no value in any pair: expected at least one note that both hit."
        )
    differences = [pair.difference for pair in pairs]
    return MetricComparison(
        metric=metric,
        pairs=pairs,
        difference=summarize(differences),
        test=signed_rank_test(differences),
    )


def _names(tasks: Iterable[_Task]) -> tuple[str, ...]:
    return tuple(_name(piece, seed) for piece, seed in tasks)


def _name(piece: str, seed: int | None) -> str:
    return piece if seed is None else f"{piece}, seed {seed}"


@dataclass(frozen=True, kw_only=True)
class SavedEpisodes:
    """Episodes of one run on one piece, in the format of :meth:`Evaluation.to_json`."""

    piece: str
    """Piece that was played."""
    episode_seeds: tuple[int, ...]
    """Seed of each episode."""
    episodes: tuple[Mapping[str, float], ...]
    """Metrics of each episode, by name."""
    training_seed: int | None = None
    """Seed of the training; ``None`` if the evaluation has none."""
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the environment."""

    def __post_init__(self) -> None:
        if not self.episodes or len(self.episode_seeds) != len(self.episodes):
            raise ValueError(f"{len(self.episodes)} episodes with {len(self.episode_seeds)} seeds")


def _evaluations(content: Any) -> Any:
    """Return the evaluations in a file of :func:`evaluate_runs`, or a single one as a list."""
    return content.get("evaluations", [content]) if isinstance(content, dict) else content


_OneOrSeveral = Annotated[list[SavedEpisodes], BeforeValidator(_evaluations)]


def read_episodes(source: str | os.PathLike[str]) -> list[SavedEpisodes]:
    """Read the episodes of an evaluation's JSON file, a take, a run, or a folder of runs."""
    path = Path(source)
    if os.path.isfile(path):
        return _read_file(path)
    if not os.path.isdir(path):
        raise RunError(
            f"There is no '{path}': expected a JSON file of 'sb3-piano evaluate --json', a take, "
            "the folder of an evaluated run, or a folder of such runs."
        )
    runs = _runs_in(path)
    if not runs:
        raise RunError(
            f"'{path}' is no run and holds none: expected a folder that 'sb3-piano train' made, or "
            "a folder of such runs, such as a sweep."
        )
    files = [run.evaluation_dir / "metrics.json" for run in runs]
    for run, file in zip(runs, files, strict=True):
        if not os.path.isfile(file):
            raise RunError(
                f"Run '{run.path}' has no evaluation: expected evaluation/metrics.json. To make "
                f"it: sb3-piano evaluate {shlex.quote(str(run.path))}"
            )
    return [saved for file in files for saved in _read_file(file)]


def _runs_in(path: Path) -> list[RunFolder]:
    """Return the folder itself if it is a run, else all runs below it, at any depth."""
    runs = []
    for folder, below, files in os.walk(path):
        below.sort()
        run = RunFolder(Path(folder))
        if run.config_file.name in files:
            runs.append(run)
            below.clear()  # a corrected run inside it is no run of its own
    return runs


def _read_file(file: Path) -> list[SavedEpisodes]:
    if file.suffix == SUFFIX:
        take = Take.read(file)
        return [
            SavedEpisodes(
                piece=take.title,
                episode_seeds=(take.seed or 0,),
                episodes=(take.metrics,),
                env_kwargs=take.env.get("options", {}),
            )
        ]
    wanted = "expected a file that 'sb3-piano evaluate' of this version wrote."
    found = read_json(file, _OneOrSeveral, wanted)
    if not found:
        raise RunError(f"'{file}' holds no evaluation: no run could be evaluated then.")
    return found
