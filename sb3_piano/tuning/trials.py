"""Trials in a study's store: what is noted with them, which count, and which are run again."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import optuna
from optuna.exceptions import ExperimentalWarning, UpdateFinishedTrialError
from optuna.storages import RetryHeartbeatStaleTrialCallback
from optuna.trial import FrozenTrial, TrialState

STATES = {
    TrialState.COMPLETE: "complete",
    TrialState.PRUNED: "pruned",
    TrialState.FAIL: "failed",
    TrialState.RUNNING: "running",
    TrialState.WAITING: "waiting",
}
"""States as users read them."""

# What is noted with a trial (Optuna's user attributes).
HOST = "host"  # the machine that ran it
FOLDER = "folder"  # its runs, on that machine
OWNER = "owner"  # the machine whose command asked for it, the study's folder there, the job's name
ORIGIN = "origin"  # source of its settings, if the sampler did not choose them
FAILURE = "failure"  # why it failed, in one line
INTERRUPTED = "interrupted"  # whether someone stopped it; another trial has its settings then
STEPS = "steps"  # environment steps of all its trainings
SECONDS = "seconds"  # time it took
VALUES = "values"  # its value by seed, in the order of the study's seeds; shorter if it was pruned

# Origins: the settings from which the study departs, or those of them that the space holds.
PRESET = "preset"
PRESET_IN_PART = "preset in part"

GONE = "its process ended without a word: killed, or out of memory"
STOPPED = "someone stopped it"
"""Reasons of failed trials that have noted none."""
MAX_RETRIES = 3
"""Number of times that the settings of a trial are queued again because its process was gone."""


def retry(study: optuna.Study, trial: FrozenTrial) -> None:
    """Queue the settings of a failed trial again whose process was gone, at most some times.

    Interruptions are no retries. Of what is noted with the trial only the origin stays.
    """
    history, trials = (*_history(trial), trial.number), study.get_trials(deepcopy=False)
    interruptions = sum(INTERRUPTED in trials[number].user_attrs for number in history)
    trial.user_attrs = {name: v for name, v in trial.user_attrs.items() if name == ORIGIN}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        RetryHeartbeatStaleTrialCallback(MAX_RETRIES + interruptions)(study, trial)


def requeue_lost(study: optuna.Study, is_lost: Callable[[FrozenTrial], bool]) -> None:
    """Fail the running trials that are lost, and queue again all that failed without a reason.

    Each is queued once, however often this is called. ``is_lost`` says of a trial that runs, or
    ended without a reason, that this process has to look after it.
    """
    trials = study.get_trials()
    again = {number for trial in trials for number in _history(trial)}
    for trial in trials:
        running = trial.state is TrialState.RUNNING
        silent = running or (_failed(trial) and FAILURE not in trial.user_attrs)
        if trial.number in again or not silent or not is_lost(trial):
            continue
        if running:
            try:
                study.tell(trial.number, state=TrialState.FAIL)
            except (ValueError, UpdateFinishedTrialError):  # it has just ended
                continue
        retry(study, trial)


def repeated(trials: Iterable[FrozenTrial]) -> set[int]:
    """Return the numbers of the trials that do not count, as another one has their settings.

    These are the ones whose process was gone, if they were queued again, and those that someone
    stopped.
    """
    trials = list(trials)
    stopped = {t.number for t in trials if _failed(t) and t.user_attrs.get(INTERRUPTED)}
    return stopped.union(*map(_history, trials))


def counting(study: optuna.Study) -> list[FrozenTrial]:
    """Return the trials that count, also those that wait or run."""
    trials = study.get_trials(deepcopy=False)
    without = repeated(trials)
    return [trial for trial in trials if trial.number not in without]


def best_first(study: optuna.Study) -> list[FrozenTrial]:
    """Return the complete trials, the one with the highest value first, the first of equals."""
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    return sorted(complete, key=_value, reverse=True)


def best_trial(study: optuna.Study) -> FrozenTrial | None:
    """Return the first of them, if there is one."""
    return next(iter(best_first(study)), None)


def preset_trial(study: optuna.Study) -> FrozenTrial | None:
    """Return the complete trial with the settings from which the study departs, if there is one."""
    return next((t for t in best_first(study) if t.user_attrs.get(ORIGIN) == PRESET), None)


def failure_of(trial: FrozenTrial) -> str | None:
    """Return why a trial failed; ``None`` if it did not."""
    silent = STOPPED if INTERRUPTED in trial.user_attrs else GONE
    return trial.user_attrs.get(FAILURE, silent) if _failed(trial) else None


def summary(trials: Sequence[FrozenTrial], label: str) -> str:
    """Return ``"7 trials (2 running, 3 pruned), highest final f1 0.430 (trial 5)"``."""
    counts = Counter(trial.state for trial in trials)
    told = (TrialState.RUNNING, TrialState.PRUNED, TrialState.FAIL)
    details = ", ".join(f"{counts[state]} {STATES[state]}" for state in told if counts[state])
    text = f"{sum(trial.state.is_finished() for trial in trials)} trials"
    text += f" ({details})" if details else ""
    complete = (trial for trial in trials if trial.state is TrialState.COMPLETE)
    best = max(complete, key=_value, default=None)
    return f"{text}, highest {label} {best.value:.3f} (trial {best.number})" if best else text


def _value(trial: FrozenTrial) -> float:
    assert trial.value is not None, "a complete trial has a value"
    return trial.value


def _failed(trial: FrozenTrial) -> bool:
    return trial.state is TrialState.FAIL


def _history(trial: FrozenTrial) -> list[int]:
    """Return the numbers of the trials before that had the same settings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        return RetryHeartbeatStaleTrialCallback.retry_history(trial)
