"""Trials whose worker is gone, and trials that someone stopped: their settings are queued again."""

from __future__ import annotations

import copy

import optuna
from optuna.exceptions import UpdateFinishedTrialError
from optuna.storages import (
    JournalStorage,
    RetryHeartbeatStaleTrialCallback,
    fail_stale_trials,
)
from optuna.storages._heartbeat import BaseHeartbeat
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.tuning.attributes import FAILURE, HOST, ORIGIN, WORKER
from sb3_piano.tuning.store.experimental import experimental_allowed
from sb3_piano.tuning.store.locks import any_held, dead_workers, is_held, remove_dead
from sb3_piano.tuning.study_folder import StudyFolder

MAX_RETRIES = 3
"""How often the settings of a trial are queued again because its worker was gone."""

_SUSPECTED = "suspected"
_RUNG = "completed_rung_"  # of Optuna's successive halving


class RetryWithoutTraces(RetryHeartbeatStaleTrialCallback):
    """Queue the settings of a trial whose worker was gone, but not what it had come to.

    Optuna's own callback also copies by whom it was run and why it failed, and the values by which
    successive halving had let it go on, so that the new trial would never be judged.
    """

    def __call__(self, study: optuna.Study, trial: FrozenTrial) -> None:
        """Queue the settings of a trial, if they were not queued too often."""
        super().__call__(study, _without_traces(trial))


def retry_callback() -> RetryWithoutTraces:
    """Return what queues the settings of a trial whose worker was gone."""
    with experimental_allowed():
        return RetryWithoutTraces(max_retry=MAX_RETRIES)


def requeue(study: optuna.Study, trial: FrozenTrial) -> bool:
    """Let a running trial fail because its worker is gone, and queue its settings again.

    They are queued at most :data:`MAX_RETRIES` times.

    Returns:
        Whether this call did it. If several processes try, exactly one of them does.
    """
    storage = study._storage  # as Optuna's fail_stale_trials does
    try:
        storage.set_trial_user_attr(trial._trial_id, FAILURE, _gone(trial))
        if not storage.set_trial_state_values(trial._trial_id, state=TrialState.FAIL):
            return False
    except UpdateFinishedTrialError:
        return False
    retry_callback()(study, storage.get_trial(trial._trial_id))
    return True


def requeue_orphans(study: optuna.Study, folder: StudyFolder) -> list[int]:
    """Queue the settings of trials again whose worker on this machine is gone.

    In a database, trials of other machines are told by their heartbeats, as before each trial.

    Args:
        study: The study.
        folder: Its folder on this machine.

    Returns:
        The numbers of the trials that this call found by their workers' locks.
    """
    # Before the trials are read, so that none of the dead can have begun another one.
    dead = dead_workers(folder, of_this_machine=not _is_embedded(study))
    running = study.get_trials(deepcopy=False, states=(TrialState.RUNNING,))
    orphans = [trial for trial in running if _is_orphan(study, trial, folder, dead)]
    requeued = [trial.number for trial in orphans if requeue(study, trial)]
    for name in dead:
        remove_dead(folder, name)
    _requeue_stale(study, running)
    return requeued


def requeue_interrupted(study: optuna.Study, trial: FrozenTrial) -> None:
    """Queue the settings again of a trial that someone stopped; it is no retry.

    Args:
        study: The study.
        trial: The trial, which has failed with the attribute
            :data:`~sb3_piano.tuning.attributes.INTERRUPTED`.
    """
    bare = _without_traces(trial)
    study.add_trial(
        optuna.create_trial(
            state=TrialState.WAITING,
            params=bare.params,
            distributions=bare.distributions,
            user_attrs=bare.user_attrs,
            system_attrs=bare.system_attrs,
        )
    )


def _is_embedded(study: optuna.Study) -> bool:
    """Return whether a study is in its folder, and so all its workers on one machine."""
    return isinstance(study._storage, JournalStorage)


def _is_orphan(
    study: optuna.Study, trial: FrozenTrial, folder: StudyFolder, dead: list[str]
) -> bool:
    """Return whether the worker of a trial, which ran a moment ago, is gone."""
    worker = trial.user_attrs.get(WORKER)
    if worker in dead:
        return True
    if not _is_embedded(study):
        return False  # it may be another machine's
    return not any_held(folder) if worker is None else is_held(folder, worker) is None


def _requeue_stale(study: optuna.Study, running: list[FrozenTrial]) -> None:
    """Let trials fail whose heartbeat in a database has stopped, or that never had one.

    The first heartbeat comes a moment after the trial. If a worker dies in between, Optuna would
    wait for ever, so the trial gets one heartbeat here.
    """
    storage = study._storage
    if not isinstance(storage, BaseHeartbeat):
        return
    for trial in running:
        if WORKER not in trial.user_attrs and _SUSPECTED not in trial.user_attrs:
            try:
                storage.set_trial_user_attr(trial._trial_id, _SUSPECTED, True)
            except UpdateFinishedTrialError:
                continue
            storage.record_heartbeat(trial._trial_id)
    with experimental_allowed():
        fail_stale_trials(study)


def _gone(trial: FrozenTrial) -> str:
    attributes = trial.user_attrs
    if WORKER not in attributes:
        return "its worker was gone before it began"
    return f"its worker {attributes[WORKER]} on {attributes.get(HOST, 'this machine')} was gone"


def _without_traces(trial: FrozenTrial) -> FrozenTrial:
    """Return a copy of a trial that knows its settings and where they come from."""
    bare = copy.deepcopy(trial)
    bare.user_attrs = {k: v for k, v in bare.user_attrs.items() if k == ORIGIN}
    bare.system_attrs = {k: v for k, v in bare.system_attrs.items() if not k.startswith(_RUNG)}
    return bare
