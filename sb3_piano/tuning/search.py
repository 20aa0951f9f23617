"""Samplers and pruners of a study: Optuna's, by name."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import Literal

from optuna.exceptions import ExperimentalWarning
from optuna.pruners import (
    BasePruner,
    HyperbandPruner,
    MedianPruner,
    NopPruner,
    SuccessiveHalvingPruner,
)
from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, RandomSampler, TPESampler

from sb3_piano.settings import Count, Index, settings
from sb3_piano.tuning.study import StudyConfig


@settings
class Search:
    """Sampler and pruner of a study, which may change while it goes on.

    Raises:
        ConfigError: If a name is unknown or a number out of range.
    """

    sampler: Literal["tpe", "cmaes", "gp", "random"] = "tpe"
    """One of :data:`SAMPLERS`."""
    pruner: Literal["median", "hyperband", "halving", "none"] = "median"
    """One of :data:`PRUNERS`."""
    startup_trials: Count = 10
    """Trials with random settings before the sampler learns from the results; at least 1."""
    seed: Index | None = None
    """Seed of the sampler. Only with one worker are its choices the same each time."""


def make_sampler(search: Search) -> BaseSampler:
    """Return a study's sampler."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        return SAMPLERS[search.sampler](search)


def make_pruner(search: Search, config: StudyConfig) -> BasePruner:
    """Return a study's pruner.

    Its steps are environment steps, counted on through the trainings of a trial. Music metrics are
    noisy while a model learns, so the pruners are patient.
    """
    return PRUNERS[search.pruner](search, config)


def _tpe(search: Search) -> BaseSampler:
    """Tree-structured Parzen estimators, which also model how settings depend on each other.

    Trials that still run count as bad ones, so that none gets the settings of another.
    """
    return TPESampler(
        n_startup_trials=search.startup_trials,
        seed=search.seed,
        multivariate=True,
        constant_liar=True,
    )


def _cmaes(search: Search) -> BaseSampler:
    """CMA-ES, for numbers only: every ``Choice`` is drawn at random, throughout the study.

    Optuna recommends that it learns from pruned trials if successive halving ends most of them.
    """
    return CmaEsSampler(
        n_startup_trials=search.startup_trials,
        seed=search.seed,
        warn_independent_sampling=False,  # it is what the docstring says, for each trial
        consider_pruned_trials=search.pruner in ("hyperband", "halving"),
    )


def _median(search: Search, config: StudyConfig) -> BasePruner:
    """End a trial whose best value so far is below the median of what others had at that step.

    A median of a few trials says little, so half of ``startup_trials`` have to be complete (5 by
    default, as in Optuna).
    """
    return MedianPruner(n_startup_trials=search.startup_trials // 2, n_warmup_steps=_warmup(config))


def _halving(search: Search, config: StudyConfig) -> BasePruner:
    """Let the better half go on, from the first evaluation that counts to twice as many steps.

    Optuna's own default, a fourth, would end most trials by a single noisy evaluation.
    """
    del search  # the first trial goes on anyway
    return SuccessiveHalvingPruner(min_resource=_warmup(config), reduction_factor=2)


def _hyperband(search: Search, config: StudyConfig) -> BasePruner:
    """Successive halving that starts at the first evaluation for some trials, later for others."""
    del search
    most = config.config.n_timesteps * len(config.seeds)
    return HyperbandPruner(min_resource=config.interval, max_resource=most, reduction_factor=3)


def _warmup(config: StudyConfig) -> int:
    """Return the step of the first evaluation that may end a trial: the second one.

    At the first, off-policy algorithms have played at random for a good part. If a training is
    evaluated only once it is over, that evaluation counts.
    """
    return min(2 * config.interval, config.config.n_timesteps)


SAMPLERS: Mapping[str, Callable[[Search], BaseSampler]] = {
    "tpe": _tpe,
    "cmaes": _cmaes,
    # A Gaussian process; it thinks longer the more trials there are.
    "gp": lambda search: GPSampler(n_startup_trials=search.startup_trials, seed=search.seed),
    "random": lambda search: RandomSampler(seed=search.seed),
}
"""Ways to choose settings."""

PRUNERS: Mapping[str, Callable[[Search, StudyConfig], BasePruner]] = {
    "median": _median,
    "hyperband": _hyperband,
    "halving": _halving,
    "none": lambda search, config: NopPruner(),
}
"""Ways to end trials early."""
