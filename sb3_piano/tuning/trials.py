"""Trials of a study in its store: what is noted with them, which count, and which are run again."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

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
"""States as users read them."""

# Names of what is noted with a trial (Optuna's user attributes).
HOST = "host"
"""The machine that ran it."""
FOLDER = "folder"
"""Its runs, on that machine."""
OWNER = "owner"
"""The machine whose command asked for it, and the study's folder there."""
ORIGIN = "origin"
"""Source of its settings, if the sampler did not choose them."""
FAILURE = "failure"
"""Why it failed, in one line."""
INTERRUPTED = "interrupted"
"""True if someone stopped it; another trial has its settings then."""
STEPS = "steps"
"""Environment steps of all its trainings."""
SECONDS = "seconds"
"""Time it took."""
VALUES = "values"
"""Its value by seed, in the order of the study's seeds; shorter if it was pruned."""

PRESET = "preset"
"""The origin of a trial with the settings from which the study departs."""
PRESET_IN_PART = "preset in part"
"""The same where the space does not hold all of these settings; the others are sampled."""

GONE = "its process ended without a word: killed, or out of memory"
"""The reason of a failed trial that has noted none."""
MAX_RETRIES = 3
"""Number of times that the settings of a trial are queued again because its process was gone."""


def retry_callback(max_retry: int = MAX_RETRIES) -> RetryHeartbeatStaleTrialCallback:
    """Return Optuna's function that queues the settings of a failed trial again."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        return RetryHeartbeatStaleTrialCallback(max_retry=max_retry)


def requeue_lost(study: optuna.Study, is_ours: Callable[[FrozenTrial], bool]) -> None:
    """Queue the settings again of failed trials that note no failure: their process was gone.

    They are queued once for each such trial, however often this is called, and at most
    :data:`MAX_RETRIES` times; interruptions do not count. Only trials are looked at of which
    ``is_ours`` says that nobody else looks after them.
    """
    trials = study.get_trials()
    again = _retried(trials)
    for trial in trials:
        lost = _failed(trial) and FAILURE not in trial.user_attrs
        if lost and trial.number not in again and is_ours(trial):
            history = (*_history(trial), trial.number)
            interruptions = sum(INTERRUPTED in trials[number].user_attrs for number in history)
            trial.user_attrs = {k: v for k, v in trial.user_attrs.items() if k == ORIGIN}
            retry_callback(MAX_RETRIES + interruptions)(study, trial)


def repeated(trials: Iterable[FrozenTrial]) -> set[int]:
    """Return the numbers of the trials that do not count, as another one has their settings.

    These are the ones whose process was gone, if they were queued again, and those that someone
    stopped.
    """
    trials = list(trials)
    stopped = {t.number for t in trials if _failed(t) and t.user_attrs.get(INTERRUPTED)}
    return stopped | _retried(trials)


def counting(study: optuna.Study) -> list[FrozenTrial]:
    """Return the trials that count, also those that wait or run."""
    trials = study.get_trials(deepcopy=False)
    without = repeated(trials)
    return [trial for trial in trials if trial.number not in without]


def best_first(study: optuna.Study) -> list[FrozenTrial]:
    """Return the complete trials, the one with the highest value first, the first of equals."""
    return sorted(complete_trials(study), key=_value, reverse=True)


def best_trial(study: optuna.Study) -> FrozenTrial | None:
    """Return the first of them, if there is one."""
    return next(iter(best_first(study)), None)


def complete_trials(study: optuna.Study) -> list[FrozenTrial]:
    """Return the trials that have a value, in their order."""
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))


def preset_trial(study: optuna.Study) -> FrozenTrial | None:
    """Return the complete trial with the settings from which the study departs, if there is one."""
    found = (t for t in complete_trials(study) if t.user_attrs.get(ORIGIN) == PRESET)
    return next(found, None)


def failure_of(trial: FrozenTrial) -> str | None:
    """Return why a trial failed; ``None`` if it did not."""
    return trial.user_attrs.get(FAILURE, GONE) if _failed(trial) else None


def summary(trials: Sequence[FrozenTrial], label: str) -> str:
    """Return ``"7 trials (2 running, 3 pruned), highest final f1 0.430 (trial 5)"``."""
    counts = Counter(trial.state for trial in trials)
    told = (TrialState.RUNNING, TrialState.PRUNED, TrialState.FAIL)
    details = ", ".join(f"{counts[state]} {STATES[state]}" for state in told if counts[state])
    text = f"{sum(trial.state.is_finished() for trial in trials)} trials"
    text += f" ({details})" if details else ""
    complete = (trial for trial in trials if trial.state is TrialState.COMPLETE)
    best = max(complete, key=_value, default=None)
    if best is None:
        return text
    return f"{text}, highest {label} {best.value:.3f} (trial {best.number})"


def _value(trial: FrozenTrial) -> float:
    assert trial.value is not None, "a complete trial has a value"
    return trial.value


def _failed(trial: FrozenTrial) -> bool:
    return trial.state is TrialState.FAIL


def _retried(trials: Iterable[FrozenTrial]) -> set[int]:
    return {number for trial in trials for number in _history(trial)}


def _history(trial: FrozenTrial) -> list[int]:
    """Return the numbers of the trials before that had the same settings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        return RetryHeartbeatStaleTrialCallback.retry_history(trial)
