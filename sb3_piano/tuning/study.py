"""A study: its search, the evaluation of its trials, which of them count, and its folder."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import warnings
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import optuna
from optuna import pruners, samplers
from optuna.exceptions import ExperimentalWarning
from optuna.storages import RetryHeartbeatStaleTrialCallback
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.callbacks import F1Callback, MetricEvalCallback, OnsetF1Callback
from sb3_piano.exceptions import ConfigError
from sb3_piano.files import FileIn
from sb3_piano.settings import Count, Index, Positive, settings
from sb3_piano.training import RunConfig
from sb3_piano.training.configuration.env_spec import FILE_OPTIONS
from sb3_piano.training.configuration.yaml_files import entry_config
from sb3_piano.tuning.space import Space

STATES = {
    TrialState.COMPLETE: "complete",
    TrialState.PRUNED: "pruned",
    TrialState.FAIL: "failed",
    TrialState.RUNNING: "running",
    TrialState.WAITING: "waiting",
}
"""Names of the states for users."""

# Attributes of a trial (Optuna's user attributes).
HOST = "host"  # the machine that ran it
FOLDER = "folder"  # its runs, on that machine
OWNER = "owner"  # name of the job that ran it
ORIGIN = "origin"  # source of its settings, if the sampler did not choose them
FAILURE = "failure"  # why it failed, in one line
STEPS = "steps"  # environment steps of all its trainings
VALUES = "values"  # its value by seed, in the order of the study's seeds; shorter if it was pruned

# Origins: the settings from which the study departs, or the part of them in the space.
PRESET = "preset"
PRESET_IN_PART = "preset in part"

MAX_RETRIES = 3  # of a trial whose process died


optuna_experiments = partial(warnings.catch_warnings, action="ignore", category=ExperimentalWarning)
"""Context manager to use experimental features of Optuna without its warnings."""

METRICS: Mapping[str, type[MetricEvalCallback]] = {
    callback.metric: callback for callback in (F1Callback, OnsetF1Callback)
}
"""Metrics of trials, and the callback that evaluates each during training."""


@settings
class StudyConfig:
    """Space of a study and evaluation of its trials: the settings that identify a study."""

    algo: str
    """Name of the algorithm."""
    env_id: str
    """Id of the environment; ``module:Id`` imports the module that registers it."""
    entry: Mapping[str, Any]
    """Settings from which trials depart, as an entry of an RL Zoo YAML file; ``n_timesteps`` are
    the environment steps of one training."""
    space: Space
    """Search space."""
    metric: Literal["f1", "onset_f1"] = "f1"
    """Metric of the trials."""
    objective: Literal["final", "best"] = "final"
    """Model that counts: the final one of a training, or its best one."""
    seeds: tuple[Index, ...] = (0,)
    """Seeds of a trial's trainings; its value is the mean."""
    eval_seed: Index = 1000
    """Seed of the evaluations; not one of ``seeds``."""
    eval_episodes: Count = 1
    """Episodes of an evaluation, at least 1. One is enough if a piece always starts alike."""
    n_evaluations: Count = 5
    """Evaluations of a training, at equal distances, at least 1; a trial may be pruned at each."""
    minutes: Positive | None = None
    """Limit for all trainings of a trial together, minutes; each has an equal share."""

    def __post_init__(self) -> None:
        seeds = {*self.seeds}
        if not seeds or len(seeds) < len(self.seeds) or self.eval_seed in seeds:
            raise ConfigError(
                f"seeds are {list(self.seeds)}, eval_seed is {self.eval_seed}: expected one or "
                "more distinct seeds, and another one for evaluations."
            )
        steps = self.config.n_timesteps
        if steps < self.n_evaluations:
            raise ConfigError(
                f"n_evaluations is {self.n_evaluations}, in {steps} steps: expected at most one "
                "evaluation for each step."
            )

    @property
    def config(self) -> RunConfig:
        """Settings of the run from which trials depart."""
        return entry_config(self.algo, self.env_id, self.entry)

    @property
    def value_name(self) -> str:
        """Name of a trial's value: "final f1"."""
        return f"{self.objective} {self.metric}"

    @property
    def interval(self) -> int:
        """Environment steps between two evaluations of a training."""
        return self.config.n_timesteps // self.n_evaluations

    def preset_params(self) -> dict[str, Any]:
        """Return the params of a trial with the entry's settings, if they are in the space."""
        return self.space.params_of(self.algo, self.env_id, self.entry)

    def identity(self) -> dict[str, Any]:
        """Return the settings that machines with one study must share, in JSON types.

        A file (a score, finger labels) is identified by its content: its path may differ between
        machines.
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
    """Sampler and pruner of a study; they may change between calls."""

    sampler: Literal["tpe", "cmaes", "gp", "random"] = "tpe"
    """Sampler of the settings."""
    pruner: Literal["median", "hyperband", "halving", "none"] = "median"
    """Pruner, which ends trials early."""
    startup_trials: Count = 10
    """Trials with random settings before the sampler uses results; at least 1."""
    seed: Index | None = None
    """Seed of the sampler. Its choices are reproducible only with one worker."""


def make_sampler(search: Search, number: int = 0) -> samplers.BaseSampler:
    """Create the sampler of a trial, seeded by the search's seed and the trial's number."""
    startup, seed = search.startup_trials, search.seed
    if seed is not None:
        seed = int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
    options: Any = {"n_startup_trials": startup, "seed": seed}
    with optuna_experiments():
        match search.sampler:
            case "tpe":  # running trials count as bad ones, so that none gets their settings
                return samplers.TPESampler(**options, multivariate=True, constant_liar=True)
            case "cmaes":  # every choice is drawn at random
                options["warn_independent_sampling"] = False
                # Optuna recommends it if successive halving ends most trials.
                options["consider_pruned_trials"] = search.pruner in ("hyperband", "halving")
                return samplers.CmaEsSampler(**options)
            case "gp":  # a Gaussian process; its time grows with the number of trials
                return samplers.GPSampler(**options)
    return samplers.RandomSampler(seed=seed)


def make_pruner(search: Search, config: StudyConfig) -> pruners.BasePruner:
    """Create a study's pruner; its steps are environment steps of all trainings of a trial.

    Music metrics are noisy during training, and off-policy algorithms act at random for much of the
    first evaluation: pruning starts at the second evaluation, or at the only one. Hyperband is an
    exception: its first bracket may end a trial at the first evaluation.
    """
    steps = config.config.n_timesteps
    warmup = min(2 * config.interval, steps)
    match search.pruner:
        case "median":  # a median of few trials is unreliable: 5 by default, as in Optuna
            startup = search.startup_trials // 2
            return pruners.MedianPruner(n_startup_trials=startup, n_warmup_steps=warmup)
        case "halving":  # Optuna's default, 4, would end most trials by one noisy evaluation
            return pruners.SuccessiveHalvingPruner(min_resource=warmup, reduction_factor=2)
        case "hyperband":
            most = steps * len(config.seeds)
            return pruners.HyperbandPruner(config.interval, most, reduction_factor=3)
    return pruners.NopPruner()


@dataclass(frozen=True)
class StudyFolder:
    """Folder of a study; the runs of trial n are in ``trials/<n>/seed_<seed>``."""

    path: Path

    journal_file = FileIn("journal.log")
    """Optuna's journal, which stores the study unless a database does."""
    best_file = FileIn("best.yml")
    """The best settings, for ``sb3-piano train --config`` and for RL Zoo."""
    report_file = FileIn("report.html")
    """Page with history, importance and more; it needs no network."""
    table_file = FileIn("trials.csv")
    """A row for each trial."""
    workers_dir = FileIn("workers")
    """Output of the worker processes, ``<name>.log`` for each."""

    def trial_dir(self, number: int) -> Path:
        """Return the folder of a trial's runs."""
        return self.path / "trials" / str(number)


def retry(study: optuna.Study, trial: FrozenTrial) -> None:
    """Queue the settings of a lost trial again, with its origin, at most ``MAX_RETRIES`` times."""
    trial.user_attrs = {name: v for name, v in trial.user_attrs.items() if name == ORIGIN}
    with optuna_experiments():
        RetryHeartbeatStaleTrialCallback(MAX_RETRIES)(study, trial)


def repeated(trials: Iterable[FrozenTrial]) -> set[int]:
    """Return the numbers of repeated trials, which do not count."""
    with optuna_experiments():
        return {n for t in trials for n in RetryHeartbeatStaleTrialCallback.retry_history(t)}


def counting(study: optuna.Study) -> list[FrozenTrial]:
    """Return the trials that count, also waiting and running ones."""
    trials = study.get_trials(deepcopy=False)
    again = repeated(trials)
    return [trial for trial in trials if trial.number not in again]


def best_first(trials: Iterable[FrozenTrial]) -> list[FrozenTrial]:
    """Return the complete trials by descending value; equal ones keep their order."""
    complete = [trial for trial in trials if trial.state is TrialState.COMPLETE]
    return sorted(complete, key=lambda trial: -trial.values[0])


def preset_trial(trials: Iterable[FrozenTrial]) -> FrozenTrial | None:
    """Find the complete trial with the settings from which the study departs."""
    return next((t for t in best_first(trials) if t.user_attrs.get(ORIGIN) == PRESET), None)


def failure_of(trial: FrozenTrial) -> str:
    """Return the reason of a trial's failure; empty if it did not fail."""
    if trial.state is not TrialState.FAIL:
        return ""
    return trial.user_attrs.get(FAILURE, "its process ended: stopped, killed, or out of memory")


def summary(trials: Sequence[FrozenTrial], value_name: str) -> str:
    """Return ``"7 trials (2 running, 3 pruned), highest final f1 0.430 (trial 5)"``."""
    counts = Counter(trial.state for trial in trials)
    told = (TrialState.RUNNING, TrialState.PRUNED, TrialState.FAIL)
    details = ", ".join(f"{counts[state]} {STATES[state]}" for state in told if counts[state])
    text = f"{sum(trial.state.is_finished() for trial in trials)} trials"
    text += f" ({details})" if details else ""
    best = next(iter(best_first(trials)), None)
    return f"{text}, highest {value_name} {best.value:.3f} (trial {best.number})" if best else text
