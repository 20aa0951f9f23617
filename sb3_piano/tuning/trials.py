"""Trials of a study: their attributes, which of them count, and which are repeated."""

from __future__ import annotations

import contextlib
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

import optuna
from optuna.exceptions import ExperimentalWarning
from optuna.storages import RetryHeartbeatStaleTrialCallback
from optuna.trial import FrozenTrial, TrialState

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

MAX_RETRIES = 3
"""Maximum number of repeats of a trial whose process died."""


@contextlib.contextmanager
def optuna_experiments() -> Iterator[None]:
    """Use experimental features of Optuna without its warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        yield


@optuna_experiments()
def retry(study: optuna.Study, trial: FrozenTrial) -> None:
    """Queue the settings of a lost trial again, with its origin, at most ``MAX_RETRIES`` times."""
    trial.user_attrs = {name: v for name, v in trial.user_attrs.items() if name == ORIGIN}
    RetryHeartbeatStaleTrialCallback(MAX_RETRIES)(study, trial)


@optuna_experiments()
def repeated(trials: Iterable[FrozenTrial]) -> set[int]:
    """Return the numbers of repeated trials, which do not count."""
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
