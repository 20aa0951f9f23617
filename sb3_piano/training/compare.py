"""Comparison of two evaluations, paired piece by piece."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from sb3_piano.exceptions import ConfigError, RunError, near_names
from sb3_piano.training.comparison import Comparison, MetricComparison, Pair
from sb3_piano.training.saved_evaluations import SavedEpisodes, read_episodes
from sb3_piano.training.statistics import signed_rank_test, summarize

MAIN_METRICS = ("f1", "onset_f1", "non_silent_f1", "return", "normalized_return")
"""What is compared, and shown of several runs, unless metrics are named."""

PAIRINGS = ("piece", "seed", "training-seed")
"""What may make a pair: a piece, or a seed of its evaluation or of the training, for each piece."""


def compare(
    a: str | os.PathLike[str],
    b: str | os.PathLike[str],
    metrics: Sequence[str] | None = None,
    *,
    by: str = "piece",
) -> Comparison:
    """Compare what two runs, or two sets of runs, reach at the same pieces.

    Pieces differ much more in how hard they are than methods do in how well they play. The
    difference within each piece is free of that, as in the evaluation of the curriculum paper.

    Args:
        a: What evaluation wrote: its JSON file, the folder of a run, or a folder of runs. Episodes
            of one piece are taken together, also those of several runs.
        b: Likewise; differences are B - A.
        metrics: Names of the metrics; by default those of :data:`MAIN_METRICS` that there are.
        by: "piece" pairs the means over all episodes of a piece, "seed" those over the episodes of
            one evaluation seed of a piece, "training-seed" those of the runs that were trained from
            one seed. Seeds of one piece are no independent evidence on how the two compare on
            others.

    Raises:
        ConfigError: If ``by`` or a metric is unknown.
        RunError: If there is no evaluation, it is damaged, or the two have nothing in common.

    Source:
        Demsar, Statistical Comparisons of Classifiers over Multiple Data Sets (2006): one pair for
        each task, compared by the signed-rank test.
    """
    if by not in PAIRINGS:
        raise ConfigError(
            f"by is {by!r}: expected one of {', '.join(map(repr, PAIRINGS))}."
            f"{near_names(str(by), PAIRINGS)}"
        )
    sides = [_Side(str(source), read_episodes(source), by) for source in (a, b)]
    common = [task for task in sides[0].tasks if task in sides[1].tasks]
    if not common:
        raise RunError(
            f"'{a}' and '{b}' have no {by} in common: expected evaluations of the same. The former "
            f"has {_listed(sides[0].tasks)}; the latter has {_listed(sides[1].tasks)}."
        )
    return Comparison(
        a=sides[0].source,
        b=sides[1].source,
        by=by,
        metrics=tuple(_compare(name, common, *sides) for name in _chosen(metrics, common, *sides)),
        physics_a=sides[0].physics(common),
        physics_b=sides[1].physics(common),
        only_in_a=_names(task for task in sides[0].tasks if task not in common),
        only_in_b=_names(task for task in sides[1].tasks if task not in common),
    )


_Task = tuple[str, int | None]  # piece and seed


class _Side:
    """The episodes of A or of B by their task."""

    def __init__(self, source: str, episodes: Iterable[SavedEpisodes], by: str):
        self.source = source
        self.tasks: dict[_Task, list[Mapping[str, float]]] = {}
        self._physics: dict[_Task, set[str]] = {}
        for saved in episodes:
            for seed, metrics in zip(saved.seeds, saved.metrics, strict=True):
                task = (saved.piece, _paired_seed(by, seed, saved, source))
                self.tasks.setdefault(task, []).append(metrics)
                self._physics.setdefault(task, set()).add(saved.physics)

    def physics(self, tasks: Iterable[_Task]) -> tuple[str, ...]:
        """Return the physics profiles on which some tasks were played."""
        return tuple(sorted(set().union(*(self._physics[task] for task in tasks))))

    def names(self, tasks: Iterable[_Task]) -> list[str]:
        """Return the names of the metrics that all episodes of some tasks have."""
        episodes = [metrics for task in tasks for metrics in self.tasks[task]]
        return [name for name in episodes[0] if all(name in metrics for metrics in episodes)]

    def mean(self, task: _Task, name: str) -> float:
        return float(np.mean([metrics[name] for metrics in self.tasks[task]]))


def _paired_seed(by: str, seed: int, saved: SavedEpisodes, source: str) -> int | None:
    """Return the seed by which an episode is paired, if it is paired by one."""
    if by == "piece":
        return None
    if by == "seed":
        return seed
    if saved.training_seed is None:
        raise RunError(
            f"The evaluation of {saved.piece} in '{source}' does not tell the training's seed: "
            "expected one that 'sb3-piano evaluate' of this version wrote."
        )
    return saved.training_seed


def _chosen(metrics: Sequence[str] | None, tasks: list[_Task], a: _Side, b: _Side) -> list[str]:
    of_b = b.names(tasks)
    known = [name for name in a.names(tasks) if name in of_b]
    if metrics is None:
        return [name for name in MAIN_METRICS if name in known] or known
    return checked_metrics(metrics, known)


def checked_metrics(metrics: Sequence[str], known: Iterable[str]) -> list[str]:
    """Return names of metrics, each once.

    Raises:
        ConfigError: If one is not known.
    """
    known = list(known)
    for name in metrics:
        if name not in known:
            raise ConfigError(
                f"Unknown metric {name!r}.{near_names(name, known)} Expected one of "
                f"{', '.join(known)}."
            )
    return list(dict.fromkeys(metrics))


def _compare(metric: str, tasks: list[_Task], a: _Side, b: _Side) -> MetricComparison:
    pairs = tuple(
        Pair(piece=task[0], seed=task[1], a=a.mean(task, metric), b=b.mean(task, metric))
        for task in tasks
    )
    differences = [pair.difference for pair in pairs]
    return MetricComparison(
        metric=metric,
        pairs=pairs,
        difference=summarize(differences),
        test=signed_rank_test(differences),
    )


def _names(tasks: Iterable[_Task]) -> tuple[str, ...]:
    return tuple(piece if seed is None else f"{piece}, seed {seed}" for piece, seed in tasks)


def _listed(tasks: Iterable[_Task]) -> str:
    return "; ".join(_names(tasks))
