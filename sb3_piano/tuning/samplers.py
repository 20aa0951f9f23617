"""How a study chooses settings, and which trials it ends early: Optuna's ways, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from optuna.pruners import (
    BasePruner,
    HyperbandPruner,
    MedianPruner,
    NopPruner,
    SuccessiveHalvingPruner,
)
from optuna.samplers import BaseSampler, CmaEsSampler, GPSampler, RandomSampler, TPESampler

from sb3_piano.exceptions import ConfigError
from sb3_piano.tuning.store.experimental import experimental_allowed
from sb3_piano.tuning.study_config import StudyConfig, check_choice


@dataclass(frozen=True, kw_only=True)
class Search:
    """How settings are chosen and trials ended early; it may change while a study goes on.

    Raises:
        ConfigError: If a name is unknown or a number out of range.
    """

    sampler: str = "tpe"
    """One of :data:`SAMPLERS`."""
    pruner: str = "median"
    """One of :data:`PRUNERS`."""
    startup_trials: int = 10
    """Trials with random settings before the sampler learns from the results; at least 1."""
    seed: int | None = None
    """Seed of the sampler, at least 0. Only with one worker are its choices the same each time."""

    def __post_init__(self) -> None:
        check_choice("sampler", self.sampler, SAMPLERS)
        check_choice("pruner", self.pruner, PRUNERS)
        if self.startup_trials < 1:
            raise ConfigError(f"startup_trials is {self.startup_trials}: expected 1 or more.")
        if self.seed is not None and self.seed < 0:
            raise ConfigError(f"seed is {self.seed}: expected 0 or more.")


def make_sampler(search: Search, worker: int = 0) -> BaseSampler:
    """Return a study's sampler.

    Args:
        search: The settings.
        worker: The number of the worker that uses it. Each has a seed of its own, as all of them
            would suggest the same otherwise.
    """
    seed = None if search.seed is None else search.seed + worker
    with experimental_allowed():
        return SAMPLERS[search.sampler](search, seed)


def make_pruner(search: Search, config: StudyConfig) -> BasePruner:
    """Return a study's pruner.

    Its steps are environment steps, counted on through the trainings of a trial. Music metrics are
    noisy while a model learns, so the pruners are patient.

    Args:
        search: The settings.
        config: The study.
    """
    return PRUNERS[search.pruner](search, config)


def _tpe(search: Search, seed: int | None) -> BaseSampler:
    """Tree-structured Parzen estimators, which also model how settings depend on each other.

    Trials that still run count as bad ones, so that workers do not suggest what another one tries.
    """
    return TPESampler(
        n_startup_trials=search.startup_trials, seed=seed, multivariate=True, constant_liar=True
    )


def _cmaes(search: Search, seed: int | None) -> BaseSampler:
    """CMA-ES, for numbers only: every ``Choice`` is drawn at random, throughout the study.

    Optuna recommends that it learns from pruned trials if successive halving ends most of them.
    """
    return CmaEsSampler(
        n_startup_trials=search.startup_trials,
        seed=seed,
        warn_independent_sampling=False,  # it is what the docstring says, for each trial
        consider_pruned_trials=search.pruner in ("hyperband", "halving"),
    )


def _gp(search: Search, seed: int | None) -> BaseSampler:
    """A Gaussian process; it thinks longer the more trials there are."""
    return GPSampler(n_startup_trials=search.startup_trials, seed=seed)


def _random(search: Search, seed: int | None) -> BaseSampler:
    del search  # it never learns
    return RandomSampler(seed=seed)


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
    return HyperbandPruner(
        min_resource=_interval(config),
        max_resource=config.config.n_timesteps * len(config.seeds),
        reduction_factor=3,
    )


def _none(search: Search, config: StudyConfig) -> BasePruner:
    del search, config
    return NopPruner()


def _interval(config: StudyConfig) -> int:
    return config.config.n_timesteps // config.n_evaluations


def _warmup(config: StudyConfig) -> int:
    """Return the step of the first evaluation that may end a trial: the second one.

    At the first, off-policy algorithms have played at random for a good part. If a training is
    evaluated only once it is over, that evaluation counts.
    """
    return min(2 * _interval(config), config.config.n_timesteps)


SAMPLERS: Mapping[str, Callable[[Search, int | None], BaseSampler]] = {
    "tpe": _tpe,
    "cmaes": _cmaes,
    "gp": _gp,
    "random": _random,
}
"""What chooses settings."""

PRUNERS: Mapping[str, Callable[[Search, StudyConfig], BasePruner]] = {
    "median": _median,
    "hyperband": _hyperband,
    "halving": _halving,
    "none": _none,
}
"""What ends trials early."""
