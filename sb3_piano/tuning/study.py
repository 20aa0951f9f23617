"""A study: what is searched and how, what its trials are worth, and the folder it is in."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from optuna import pruners, samplers

from sb3_piano.callbacks import F1Callback, MetricEvalCallback, OnsetF1Callback
from sb3_piano.exceptions import ConfigError
from sb3_piano.files import Place
from sb3_piano.settings import Count, Index, Positive, settings
from sb3_piano.training import RunConfig
from sb3_piano.training.configuration.env_spec import FILE_OPTIONS
from sb3_piano.training.configuration.yaml_files import entry_config
from sb3_piano.tuning.space import Space
from sb3_piano.tuning.trials import optuna_experiments

METRICS: Mapping[str, type[MetricEvalCallback]] = {
    callback.metric: callback for callback in (F1Callback, OnsetF1Callback)
}
"""Metrics that trials may be judged by, and the callback that evaluates each during training."""


@settings
class StudyConfig:
    """Space of a study and measure of its trials: all that makes two studies the same."""

    algo: str
    """Name of the algorithm."""
    env_id: str
    """Id of the environment; ``module:Id`` imports the module that registers it."""
    entry: Mapping[str, Any]
    """The settings from which trials depart, as an entry of an RL Zoo YAML file; ``n_timesteps``
    are the environment steps of one training."""
    space: Space
    """Space that is searched."""
    metric: Literal["f1", "onset_f1"] = "f1"
    """What trials are judged by."""
    objective: Literal["final", "best"] = "final"
    """The model that counts: the one at the end of a training, or the best one it had."""
    seeds: tuple[Index, ...] = (0,)
    """A trial trains once from each of these seeds; its value is the mean."""
    eval_seed: Index = 1000
    """Seed of the evaluations; none of ``seeds``."""
    eval_episodes: Count = 1
    """Episodes of an evaluation, at least 1. One is enough for a piece that always starts alike."""
    n_evaluations: Count = 5
    """Evaluations of a training, at equal distances, at least 1; a trial may be pruned at each."""
    minutes: Positive | None = None
    """The longest that the trainings of a trial may take together; each has an equal share."""

    def __post_init__(self) -> None:
        seeds = {*self.seeds}
        if not seeds or len(seeds) < len(self.seeds) or self.eval_seed in seeds:
            raise ConfigError(
                f"seeds are {list(self.seeds)}, eval_seed is {self.eval_seed}: expected one or "
                "more, each only once, and another one for evaluations."
            )
        steps = self.config.n_timesteps
        if steps < self.n_evaluations:
            raise ConfigError(
                f"n_evaluations is {self.n_evaluations}, in {steps} steps: expected at most one "
                "evaluation for each step."
            )

    @property
    def config(self) -> RunConfig:
        """The run from which trials depart."""
        return entry_config(self.algo, self.env_id, self.entry)

    @property
    def value_name(self) -> str:
        """What the value of a trial is: "final f1"."""
        return f"{self.objective} {self.metric}"

    @property
    def interval(self) -> int:
        """Environment steps between two evaluations of a training."""
        return self.config.n_timesteps // self.n_evaluations

    def preset_params(self) -> dict[str, Any]:
        """Return the params of a trial with the entry's settings, as far as they are searched."""
        return self.space.params_of(self.algo, self.env_id, self.entry)

    def identity(self) -> dict[str, Any]:
        """Return what has to be equal where several machines work on one study, in JSON's types.

        A file (a score, finger labels) stands there by its content: its path may be another on each
        machine.
        """
        kwargs, files = dict(self.config.env_kwargs), {}
        for option in FILE_OPTIONS:
            file = Path(str(kwargs.get(option)))
            if file.is_file():
                files[option] = f"sha256 {hashlib.sha256(file.read_bytes()).hexdigest()}"
        entry = {**self.entry, "env_kwargs": kwargs | files} if files else dict(self.entry)
        mapping = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return json.loads(json.dumps({**mapping, "space": self.space.to_mapping(), "entry": entry}))


@settings
class Search:
    """Sampler and pruner of a study, which may change while it goes on."""

    sampler: Literal["tpe", "cmaes", "gp", "random"] = "tpe"
    """Chooses the settings of trials."""
    pruner: Literal["median", "hyperband", "halving", "none"] = "median"
    """Ends trials early."""
    startup_trials: Count = 10
    """Trials with random settings before the sampler learns from the results; at least 1."""
    seed: Index | None = None
    """Seed of the sampler. Only with one worker are its choices the same each time."""


@optuna_experiments()
def make_sampler(search: Search, number: int = 0) -> samplers.BaseSampler:
    """Return the sampler of a trial, which has a seed of its own, whoever runs it."""
    startup, seed = search.startup_trials, search.seed
    if seed is not None:
        seed = int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
    options: Any = {"n_startup_trials": startup, "seed": seed}
    match search.sampler:
        case "tpe":  # trials that run count as bad ones, so that none gets their settings
            return samplers.TPESampler(**options, multivariate=True, constant_liar=True)
        case "cmaes":  # every choice is drawn at random
            options["warn_independent_sampling"] = False
            # Optuna recommends it where successive halving ends most trials.
            options["consider_pruned_trials"] = search.pruner in ("hyperband", "halving")
            return samplers.CmaEsSampler(**options)
        case "gp":  # a Gaussian process; it thinks longer the more trials there are
            return samplers.GPSampler(**options)
    return samplers.RandomSampler(seed=seed)


def make_pruner(search: Search, config: StudyConfig) -> pruners.BasePruner:
    """Return a study's pruner, whose steps are environment steps of all trainings of a trial.

    Music metrics are noisy while a model learns, and off-policy algorithms play at random for a
    good part of the first evaluation: the first one that may end a trial is the second, or the only
    one. Hyperband's brackets differ in this: the first of them may end a trial at once.
    """
    steps = config.config.n_timesteps
    warmup = min(2 * config.interval, steps)
    match search.pruner:
        case "median":  # a median of a few trials says little: 5 by default, as in Optuna
            startup = search.startup_trials // 2
            return pruners.MedianPruner(n_startup_trials=startup, n_warmup_steps=warmup)
        case "halving":  # Optuna's own factor, 4, would end most trials by one noisy evaluation
            return pruners.SuccessiveHalvingPruner(min_resource=warmup, reduction_factor=2)
        case "hyperband":
            most = steps * len(config.seeds)
            return pruners.HyperbandPruner(config.interval, most, reduction_factor=3)
    return pruners.NopPruner()


@dataclass(frozen=True)
class StudyFolder:
    """A study's folder; the runs of trial n are in ``trials/<n>/seed_<seed>``."""

    path: Path

    journal_file = Place("journal.log")
    """Optuna's journal, the store of the study unless it is in a database."""
    best_file = Place("best.yml")
    """The best settings, for ``sb3-piano train --config`` and for RL Zoo."""
    report_file = Place("report.html")
    """History, importance and more in one page that needs no network."""
    table_file = Place("trials.csv")
    """A row for each trial."""
    workers_dir = Place("workers")
    """A ``<name>.log`` with what each worker process printed."""

    def trial_dir(self, number: int) -> Path:
        """Return where the runs of a trial are."""
        return self.path / "trials" / str(number)
