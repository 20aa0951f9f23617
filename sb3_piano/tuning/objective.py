"""What an Optuna study maximises: a music metric of a model trained with the trial's settings."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training import RunConfig, evaluate, train


class Objective:
    """Train with the settings of a trial, evaluate, and return one metric.

    Each trial is a run like any other, in the folder ``trial_<number>``::

        space = {"learning_rate": FloatDistribution(1e-4, 1e-3, log=True)}
        study = optuna.create_study(direction="maximize")
        study.optimize(Objective(config, space, "runs/study"), n_trials=20)

    Args:
        config: The settings that all trials share.
        space: What is searched: arguments of the algorithm by name, or of the environment as
            ``env_kwargs.<name>``.
        runs_dir: Where the trials' runs are kept.
        metric: Name of the metric in :class:`~sb3_piano.training.Evaluation`.
        episodes: Episodes of the evaluation, whose mean counts.
        seed: Seed of the evaluation.

    Raises:
        ConfigError: If a distribution is of a kind that is not known here.
    """

    def __init__(
        self,
        config: RunConfig,
        space: Mapping[str, BaseDistribution],
        runs_dir: str | os.PathLike[str],
        *,
        metric: str = "f1",
        episodes: int = 1,
        seed: int = 0,
    ):
        for name, distribution in space.items():
            if not isinstance(
                distribution, (CategoricalDistribution, FloatDistribution, IntDistribution)
            ):
                raise ConfigError(
                    f"The space of {name!r} is {distribution!r}: expected a distribution of "
                    "optuna.distributions."
                )
        self.config = config
        self.space = dict(space)
        self.runs_dir = Path(runs_dir)
        self.metric = metric
        self.episodes = episodes
        self.seed = seed

    def __call__(self, trial: optuna.Trial) -> float:
        """Run a trial.

        Raises:
            ConfigError: If a setting is unknown or does not fit, or there is no such metric.
            RunError: If the trial's folder cannot be used.
        """
        folder = self.runs_dir / f"trial_{trial.number}"
        train(self.trial_config(trial), folder, progress_bar=False)
        evaluation = evaluate(folder, self.episodes, self.seed)
        if evaluation.interrupted:
            raise KeyboardInterrupt  # a mean over fewer episodes would not be like the others
        found = evaluation.mean
        if self.metric not in found:
            raise ConfigError(
                f"metric is {self.metric!r}.{near_names(self.metric, found)} Expected one of "
                f"{', '.join(found)}."
            )
        return found[self.metric]

    def trial_config(self, trial: optuna.Trial) -> RunConfig:
        """Return the shared settings with those that the trial suggests."""
        algorithm_kwargs = dict(self.config.algorithm_kwargs)
        env_kwargs = dict(self.config.env_kwargs)
        for name, distribution in self.space.items():
            target, key = algorithm_kwargs, name
            if name.startswith("env_kwargs."):
                target, key = env_kwargs, name.removeprefix("env_kwargs.")
            target[key] = _suggest(trial, name, distribution)
        return dataclasses.replace(
            self.config, algorithm_kwargs=algorithm_kwargs, env_kwargs=env_kwargs
        )


def _suggest(trial: optuna.Trial, name: str, distribution: BaseDistribution) -> Any:
    if isinstance(distribution, CategoricalDistribution):
        return trial.suggest_categorical(name, distribution.choices)
    if isinstance(distribution, IntDistribution):
        return trial.suggest_int(
            name,
            distribution.low,
            distribution.high,
            step=distribution.step,
            log=distribution.log,
        )
    assert isinstance(distribution, FloatDistribution), "checked by the constructor"
    return trial.suggest_float(
        name, distribution.low, distribution.high, step=distribution.step, log=distribution.log
    )
