"""The settings of trials are queued again if their worker is gone, exactly once."""

from __future__ import annotations

import multiprocessing
import time
import uuid
from collections.abc import Callable

import optuna
import pytest
import sqlalchemy
from optuna.exceptions import ExperimentalWarning
from optuna.samplers import RandomSampler
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.tuning.attributes import (
    FAILURE,
    HOST,
    INTERRUPTED,
    ORIGIN,
    PRESET,
    WORKER,
    counting,
    repeated,
)
from sb3_piano.tuning.store.locks import is_held, worker_lock
from sb3_piano.tuning.store.orphans import requeue, requeue_interrupted, requeue_orphans
from sb3_piano.tuning.store.storage import open_storage
from sb3_piano.tuning.study_folder import StudyFolder

# Optuna means ask and tell, with which no heart beats.
pytestmark = pytest.mark.filterwarnings("ignore:Heartbeat of storage:UserWarning")

FORK = multiprocessing.get_context("fork")


class Store:
    """A study's folder and its store, with heartbeats that are quickly missed."""

    def __init__(self, folder: StudyFolder, url: str | None):
        self.folder = folder
        self.url = url
        self.name = uuid.uuid4().hex

    def study(self) -> optuna.Study:
        """Return the study with a connection of its own, as each process needs."""
        storage = open_storage(self.url, self.folder, heartbeat_interval=1, grace_period=2)
        return optuna.create_study(
            study_name=self.name,
            storage=storage,
            sampler=RandomSampler(seed=0),
            direction="maximize",
            load_if_exists=True,
        )


@pytest.fixture
def embedded(tmp_path) -> Store:
    return Store(StudyFolder(tmp_path), None)


@pytest.fixture
def database(tmp_path, postgresql_url) -> Store:
    return Store(StudyFolder(tmp_path), postgresql_url)


@pytest.fixture(params=["embedded", "database"])
def store(request) -> Store:
    return request.getfixturevalue(request.param)


def begin(study: optuna.Study, worker: str | None = None, **attributes) -> optuna.Trial:
    trial = study.ask()
    if worker is not None:
        trial.set_user_attr(WORKER, worker)
        trial.set_user_attr(HOST, "pianohost")
    for name, value in attributes.items():
        trial.set_user_attr(name, value)
    trial.suggest_float("x", 0.0, 1.0)
    trial.suggest_categorical("net", ["small", "large"])
    return trial


def state_of(study: optuna.Study, number: int) -> FrozenTrial:
    return study.get_trials()[number]


def work(store: Store, begun) -> None:
    with worker_lock(store.folder) as name:
        trial = begin(store.study(), name)
        trial.report(0.5, 1)
        begun.put((name, trial.number))
        time.sleep(60)


def run_and_kill(target: Callable, *arguments) -> object:
    """Run a function in a process, kill that once it has said something, and return that."""
    said = FORK.Queue()
    process = FORK.Process(target=target, args=(*arguments, said))
    process.start()
    try:
        return said.get(timeout=30)
    finally:
        process.kill()
        process.join()


@pytest.mark.slow
def test_the_trial_of_a_killed_worker_fails_and_its_settings_are_queued_again(store):
    study = store.study()
    name, number = run_and_kill(work, store)
    assert requeue_orphans(study, store.folder) == [number]
    dead, again = study.get_trials()
    assert dead.state is TrialState.FAIL
    assert dead.user_attrs[FAILURE] == f"its worker {name} on pianohost was gone"
    assert again.state is TrialState.WAITING
    assert again.params == dead.params
    assert set(again.params) == {"x", "net"}
    assert (again.user_attrs, again.intermediate_values) == ({}, {})
    assert is_held(store.folder, name) is None  # its lock file is gone too


@pytest.mark.slow
def test_the_next_trial_has_the_settings_of_the_one_that_was_lost(store):
    study = store.study()
    run_and_kill(work, store)
    requeue_orphans(study, store.folder)
    trial = begin(study)
    assert trial.number == 1
    assert trial.params == state_of(study, 0).params
    study.tell(trial, 1.0)
    assert repeated(study.get_trials()) == {0}
    assert [trial.number for trial in counting(study)] == [1]


def test_the_trial_of_a_worker_that_lives_is_left_alone(store):
    study = store.study()
    with worker_lock(store.folder) as name:
        begin(study, name)
        assert requeue_orphans(study, store.folder) == []
    assert [trial.state for trial in study.get_trials()] == [TrialState.RUNNING]


@pytest.mark.slow
def test_trials_that_are_over_are_left_alone(store):
    study = store.study()
    with worker_lock(store.folder) as name:
        study.tell(begin(study, name), 1.0)
        study.tell(begin(study, name), state=TrialState.FAIL)
    before = study.get_trials()
    assert requeue_orphans(study, store.folder) == []
    assert study.get_trials() == before


def test_a_worker_whose_lock_is_not_in_the_folder_is_gone_if_the_folder_is_all_there_is(embedded):
    study = embedded.study()
    begin(study, "host-1-00000000")
    assert requeue_orphans(study, embedded.folder) == [0]


def test_a_worker_whose_lock_is_not_in_the_folder_may_live_on_another_machine(database):
    study = database.study()
    begin(study, "host-1-00000000")
    assert requeue_orphans(study, database.folder) == []
    assert [trial.state for trial in study.get_trials()] == [TrialState.RUNNING]


def other_host_lock(store: Store) -> str:
    """Leave a lock in the folder that another machine made, and that looks free from here."""
    name = "another-host-1-0123abcd"
    store.folder.workers_dir.mkdir(parents=True)
    (store.folder.workers_dir / f"{name}.lock").touch()
    return name


def test_a_study_folder_that_moved_to_another_machine_goes_on(embedded):
    study = embedded.study()
    begin(study, other_host_lock(embedded))
    assert requeue_orphans(study, embedded.folder) == [0]


def test_a_lock_of_another_machine_in_a_shared_folder_says_nothing(database):
    study = database.study()
    name = other_host_lock(database)
    begin(study, name)
    assert requeue_orphans(study, database.folder) == []
    assert is_held(database.folder, name) is False  # the file is still there


def test_a_trial_of_nobody_is_queued_again_once_no_worker_lives(embedded):
    study = embedded.study()
    begin(study)
    with worker_lock(embedded.folder):
        assert requeue_orphans(study, embedded.folder) == []
    assert requeue_orphans(study, embedded.folder) == [0]
    assert state_of(study, 0).user_attrs[FAILURE] == "its worker was gone before it began"


def until(happened: Callable[[], object]) -> None:
    for _ in range(300):
        if happened():
            return
        time.sleep(0.1)
    raise AssertionError("it never happened")


@pytest.mark.slow
def test_a_trial_of_nobody_in_a_database_is_queued_again_by_its_missing_heartbeat(database):
    study = database.study()
    params = begin(study).params
    requeue_orphans(study, database.folder)
    assert state_of(study, 0).state is TrialState.RUNNING  # it may be about to begin

    def is_queued() -> bool:
        requeue_orphans(study, database.folder)
        return len(study.get_trials()) == 2

    until(is_queued)
    assert state_of(study, 0).state is TrialState.FAIL
    assert state_of(study, 1).params == params
    assert state_of(study, 1).user_attrs == {}


def work_elsewhere(store: Store, begun) -> None:
    def objective(trial: optuna.Trial) -> float:
        trial.set_user_attr(WORKER, "elsewhere-1-00000000")
        trial.suggest_float("x", 0.0, 1.0)
        begun.put(trial.number)
        time.sleep(60)
        raise AssertionError("it is killed")

    store.study().optimize(objective, n_trials=1)


@pytest.mark.slow
def test_the_trial_of_another_machine_is_retried_when_its_heartbeat_has_stopped(database):
    study = database.study()
    run_and_kill(work_elsewhere, database)
    params = state_of(study, 0).params

    def one_more() -> bool:
        study.optimize(lambda trial: trial.suggest_float("x", 0.0, 1.0), n_trials=1)
        return state_of(study, 0).state is TrialState.FAIL

    until(one_more)
    (again,) = [t for t in study.get_trials() if t.system_attrs.get("failed_trial") == 0]
    assert (again.params, again.user_attrs) == (params, {})
    if again.state is TrialState.WAITING:
        one_more()
        again = state_of(study, again.number)
    assert (again.state, again.value) == (TrialState.COMPLETE, params["x"])


@pytest.mark.slow
def test_a_heartbeat_goes_on_after_the_server_was_away(database_url, tmp_path):
    store = Store(StudyFolder(tmp_path), database_url)
    study, other = store.study(), store.study()
    elsewhere = sqlalchemy.make_url(database_url)
    engine = sqlalchemy.create_engine(
        elsewhere.set(database="postgres"), isolation_level="AUTOCOMMIT"
    )

    def let_in(allowed: bool) -> None:
        with engine.connect() as connection:
            for statement in (
                f"ALTER DATABASE {elsewhere.database} ALLOW_CONNECTIONS {allowed}",
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                f"WHERE datname = '{elsewhere.database}'",
            ):
                connection.execute(sqlalchemy.text(statement))

    def objective(trial: optuna.Trial) -> float:
        trial.set_user_attr(WORKER, "elsewhere-1-00000000")
        let_in(False)
        time.sleep(1.5)  # a heartbeat is due each second
        let_in(True)
        time.sleep(2.5)  # more than the grace period since the last one before
        requeue_orphans(other, store.folder)
        return 1.0

    study.optimize(objective, n_trials=1)
    assert [trial.state for trial in study.get_trials()] == [TrialState.COMPLETE]
    engine.dispose()


def rival(store: Store, barrier, said) -> None:
    study = store.study()
    running = study.get_trials(states=(TrialState.RUNNING,))
    barrier.wait(30)
    said.put([trial.number for trial in running if requeue(study, trial)])


@pytest.mark.slow
def test_of_rivals_exactly_one_queues_the_settings_again(store):
    study = store.study()
    for _ in range(5):
        begin(study, "host-1-00000000")
    said, barrier = FORK.Queue(), FORK.Barrier(2)
    rivals = [FORK.Process(target=rival, args=(store, barrier, said)) for _ in range(2)]
    for process in rivals:
        process.start()
    answers = [said.get(timeout=30) for _ in rivals]
    for process in rivals:
        process.join()
    won = [number for answer in answers for number in answer]
    assert sorted(won) == [0, 1, 2, 3, 4]
    trials = study.get_trials()
    assert [trial.state for trial in trials[:5]] == [TrialState.FAIL] * 5
    again = trials[5:]
    assert sorted(trial.system_attrs["failed_trial"] for trial in again) == [0, 1, 2, 3, 4]
    assert {trial.state for trial in again} == {TrialState.WAITING}


def test_a_finished_trial_is_not_queued_again(store):
    study = store.study()
    trial = begin(study, "host-1-00000000")
    running = state_of(study, 0)
    study.tell(trial, 1.0)
    assert requeue(study, running) is False
    assert FAILURE not in state_of(study, 0).user_attrs
    assert len(study.get_trials()) == 1


def test_settings_are_tried_four_times_and_then_count_as_failed(store):
    study = store.study()
    for _ in range(4):
        begin(study, "host-1-00000000")
        assert requeue(study, study.get_trials()[-1])
    trials = study.get_trials()
    assert [trial.state for trial in trials] == [TrialState.FAIL] * 4
    assert len({trial.params["x"] for trial in trials}) == 1
    assert repeated(trials) == {0, 1, 2}
    assert [trial.number for trial in counting(study)] == [3]


def test_a_queued_trial_knows_its_origin_but_nothing_of_the_one_that_was_lost(store):
    study = store.study()
    study.enqueue_trial({"x": 0.25}, user_attrs={ORIGIN: PRESET})
    trial = begin(study, "host-1-00000000", **{INTERRUPTED: False})
    study._storage.set_trial_system_attr(trial._trial_id, "completed_rung_0", 0.9)
    requeue(study, state_of(study, 0))
    assert state_of(study, 1).user_attrs == {ORIGIN: PRESET}
    assert state_of(study, 1).system_attrs == {
        "failed_trial": 0,
        "retry_history": [0],
        "fixed_params": {"x": 0.25},
    }


@pytest.mark.slow
def test_settings_that_were_not_drawn_yet_are_queued_as_far_as_they_are_fixed(store):
    study = store.study()
    study.enqueue_trial({"x": 0.25})
    study.ask()  # and killed
    requeue(study, state_of(study, 0))
    assert study.ask().suggest_float("x", 0.0, 1.0) == 0.25


def interrupt(study: optuna.Study, trial: optuna.Trial) -> None:
    trial.set_user_attr(INTERRUPTED, True)
    trial.set_user_attr(FAILURE, "it was interrupted")
    study.tell(trial, state=TrialState.FAIL)
    requeue_interrupted(study, state_of(study, trial.number))


def test_an_interrupted_trial_is_queued_again_and_does_not_count(store):
    study = store.study()
    trial = begin(study, "host-1-00000000", **{ORIGIN: PRESET})
    params = trial.params
    interrupt(study, trial)
    again = state_of(study, 1)
    assert (again.state, again.params) == (TrialState.WAITING, params)
    assert (again.user_attrs, again.system_attrs) == ({ORIGIN: PRESET}, {})
    assert [trial.number for trial in counting(study)] == [1]


@pytest.mark.slow
def test_an_interruption_is_no_retry(store):
    study = store.study()
    for _ in range(5):
        interrupt(study, begin(study, "host-1-00000000"))
    begin(study, "host-1-00000000")
    requeue(study, state_of(study, 5))
    interrupt(study, begin(study, "host-1-00000000"))
    last = state_of(study, 7)
    assert last.system_attrs["retry_history"] == [5]
    assert last.params == state_of(study, 0).params
    assert [trial.number for trial in counting(study)] == [7]


def test_a_trial_that_failed_by_itself_counts(store):
    study = store.study()
    study.tell(begin(study, "host-1-00000000"), state=TrialState.FAIL)
    assert repeated(study.get_trials()) == set()
    assert len(counting(study)) == 1


def test_trials_that_wait_or_run_count(store):
    study = store.study()
    study.enqueue_trial({"x": 0.25})
    study.enqueue_trial({"x": 0.75})
    begin(study)
    assert [trial.number for trial in counting(study)] == [0, 1]


def test_no_experimental_warning_reaches_the_user(store, recwarn):
    study = store.study()
    begin(study, "host-1-00000000")
    requeue(study, state_of(study, 0))
    requeue_orphans(study, store.folder)
    assert not [found for found in recwarn if issubclass(found.category, ExperimentalWarning)]
