"""A team of threads does a job for each slot, and is at rest afterwards whatever happened."""

import copy
import itertools
import os
import pickle
import signal
import threading
import time

import pytest
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.threads import ThreadTeam, usable_cores

tables = Tables(__file__)

PATIENCE = 60.0  # s, after which a test that hangs fails


@pytest.fixture
def make_team():
    """Make teams and close them afterwards."""
    teams = []

    def make(*args):
        teams.append(ThreadTeam(*args))
        return teams[-1]

    yield make
    for team in teams:
        team.close()


def served_by(team, n_slots):
    """Return the thread that does the job of each slot."""
    threads = [[] for _ in range(n_slots)]
    team.run(lambda slot: threads[slot].append(threading.current_thread()))
    assert all(len(thread) == 1 for thread in threads)
    return [thread[0] for thread in threads]


def interrupt_main_thread():
    """Send Ctrl-C where the system cannot hand it to another thread, which would not wake it."""
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)


def eventually(condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.01)


@tables("n_slots, n_threads, shares")
def test_each_thread_serves_neighbouring_slots_and_the_caller_the_first_ones(
    make_team, n_slots, n_threads, shares
):
    team = make_team(n_slots, n_threads)
    threads = served_by(team, n_slots)
    assert [len(list(group)) for _, group in itertools.groupby(threads)] == shares
    assert len(set(threads)) == len(shares) == team.n_threads
    assert threads[0] is threading.current_thread()


def test_threads_work_at_the_same_time(make_team):
    barrier = threading.Barrier(3)
    make_team(3, 3).run(lambda slot: barrier.wait(PATIENCE))
    assert not barrier.broken


def test_there_are_no_more_threads_than_slots_or_usable_cores(make_team, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 3, 5})
    assert usable_cores() == 3
    assert [make_team(n).n_threads for n in (1, 2, 3, 8)] == [1, 2, 3, 3]
    assert make_team(8, 6).n_threads == 6  # as asked for


@pytest.mark.parametrize("n_threads", [0, -1, True, 1.5, "two"])
def test_what_is_no_number_of_threads_is_refused(n_threads):
    with pytest.raises(ConfigError, match=f"n_threads is {n_threads!r}: expected a whole number"):
        ThreadTeam(4, n_threads)


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_an_error_comes_when_all_threads_are_at_rest(make_team, failing):
    team, failed, finished = make_team(3, 3), threading.Event(), []

    def job(slot):
        if slot == failing:
            failed.set()
            raise LookupError(f"slot {slot}")
        assert failed.wait(PATIENCE)
        time.sleep(0.05)
        finished.append(slot)

    with pytest.raises(LookupError, match=f"slot {failing}"):
        team.run(job)
    assert sorted(finished) == sorted({0, 1, 2} - {failing})
    assert len(set(served_by(team, 3))) == 3  # and the team goes on


def test_a_thread_leaves_out_its_slots_after_one_that_failed_and_the_first_error_comes(make_team):
    called = []

    def job(slot):
        called.append(slot)
        if slot in (1, 4):
            raise LookupError(f"slot {slot}")

    with pytest.raises(LookupError, match="slot 1"):
        make_team(6, 2).run(job)
    assert sorted(called) == [0, 1, 3, 4]


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("interrupted", ["the job", "the waiting"])
def test_ctrl_c_comes_through_when_all_threads_are_at_rest(make_team, interrupted):
    team, finished = make_team(2, 2), []

    def job(slot):
        if interrupted == "the job" and slot == 0:
            signal.raise_signal(signal.SIGINT)
        elif slot == 1:
            if interrupted == "the waiting":
                time.sleep(0.05)  # the caller has nothing to do but wait
                interrupt_main_thread()
            time.sleep(0.1)
            finished.append(slot)

    with pytest.raises(KeyboardInterrupt):
        team.run(job)
    assert finished == [1]
    assert len(set(served_by(team, 2))) == 2


def test_closing_ends_the_threads_and_another_job_starts_new_ones(make_team):
    team = make_team(3, 3)
    _, *first = served_by(team, 3)
    team.close()
    team.close()
    assert not any(thread.is_alive() for thread in first)
    _, *second = served_by(team, 3)
    assert all(thread.is_alive() for thread in second)


@pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda team: pickle.loads(pickle.dumps(team))]
)
def test_a_copy_has_threads_of_its_own(make_team, duplicate):
    team = make_team(3, 2)
    first = served_by(team, 3)
    twin = duplicate(team)
    second = served_by(twin, 3)
    twin.close()
    assert first[2] is not second[2]
    assert served_by(team, 3) == first
