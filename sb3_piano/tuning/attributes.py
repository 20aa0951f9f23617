"""Names of what is noted with a trial in the store (Optuna's user attributes)."""

from __future__ import annotations

from collections.abc import Iterable

import optuna
from optuna.storages import RetryHeartbeatStaleTrialCallback
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.tuning.store.experimental import experimental_allowed

HOST = "host"
"""The machine that ran it."""
WORKER = "worker"
"""The worker that ran it, by the name of its lock in the study's folder."""
FOLDER = "folder"
"""Its runs, on that machine."""
ORIGIN = "origin"
"""Where its settings come from, if the sampler did not choose them."""
FAILURE = "failure"
"""Why it failed, in one line."""
INTERRUPTED = "interrupted"
"""True if someone stopped it; another trial has its settings then."""
STEPS = "steps"
"""Environment steps of all its trainings."""
SECONDS = "seconds"
"""How long it took."""
VALUES = "values"
"""Its value by seed, in the order of the study's seeds; shorter if it was pruned."""

PRESET = "preset"
"""The origin of a trial with the settings from which the study departs."""
PRESET_IN_PART = "preset in part"
"""The same where the space does not hold all of these settings; the others are sampled."""


def result_name(objective: str, metric: str) -> str:
    """Return the attribute of a result, such as ``best_onset_f1``: its mean over the seeds."""
    return f"{objective}_{metric}"


def repeated(trials: Iterable[FrozenTrial]) -> set[int]:
    """Return the numbers of the trials that do not count, as another one has their settings.

    These are the ones whose worker was gone, if they were queued again, and those that someone
    stopped.
    """
    numbers = set()
    for trial in trials:
        with experimental_allowed():
            numbers.update(RetryHeartbeatStaleTrialCallback.retry_history(trial))
        if trial.user_attrs.get(INTERRUPTED) and trial.state is TrialState.FAIL:
            numbers.add(trial.number)
    return numbers


def counting(study: optuna.Study) -> list[FrozenTrial]:
    """Return the trials that count, also those that wait or run."""
    trials = study.get_trials(deepcopy=False)
    without = repeated(trials)
    return [trial for trial in trials if trial.number not in without]
