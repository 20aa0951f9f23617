"""A worker's lock tells others whether it lives."""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import socket
import threading
import time
from pathlib import Path

import pytest

from sb3_piano.exceptions import RunError
from sb3_piano.tuning.store.locks import (
    WorkerLock,
    any_held,
    dead_workers,
    exclusive,
    is_held,
    remove_dead,
)
from sb3_piano.tuning.study_folder import StudyFolder

FORK = multiprocessing.get_context("fork")


@pytest.fixture
def folder(tmp_path) -> StudyFolder:
    return StudyFolder(tmp_path / "study")


def hold(folder: StudyFolder, names) -> None:
    with WorkerLock(folder) as lock:
        names.put(lock.name)
        time.sleep(60)


def killed_worker(folder: StudyFolder) -> str:
    names = FORK.Queue()
    process = FORK.Process(target=hold, args=(folder, names))
    process.start()
    name = names.get(timeout=30)
    assert is_held(folder, name) is True
    process.kill()
    process.join()
    return name


def lock_file(folder: StudyFolder, name: str) -> Path:
    return folder.workers_dir / f"{name}.lock"


def test_a_lock_is_held_while_its_worker_lives_and_leaves_no_file(folder):
    lock = WorkerLock(folder)
    assert is_held(folder, lock.name) is None
    with lock:
        assert is_held(folder, lock.name) is True
    assert is_held(folder, lock.name) is None
    assert list(folder.workers_dir.iterdir()) == []


def test_a_name_says_host_and_process_and_is_like_no_other(folder):
    name, other = WorkerLock(folder).name, WorkerLock(folder).name
    assert name.startswith(f"{socket.gethostname()}-{os.getpid()}-")
    assert name != other


def test_the_lock_of_a_killed_worker_is_free_but_its_file_is_there(folder):
    name = killed_worker(folder)
    assert is_held(folder, name) is False
    assert dead_workers(folder) == [name]
    remove_dead(folder, name)
    assert is_held(folder, name) is None
    assert dead_workers(folder) == []


def test_the_file_of_a_worker_that_lives_is_not_removed(folder):
    with WorkerLock(folder) as lock:
        remove_dead(folder, lock.name)
        assert is_held(folder, lock.name) is True
        assert dead_workers(folder) == []


def test_any_held_leaves_out_the_dead_the_named_and_locks_of_another_kind(folder):
    killed_worker(folder)
    with exclusive(folder.workers_dir / "claim.lock"):
        assert not any_held(folder)
        with WorkerLock(folder) as lock:
            assert any_held(folder)
            assert not any_held(folder, but=[lock.name])
    assert any_held(StudyFolder(folder.path / "elsewhere")) is False


def fork_and_hold(folder: StudyFolder, names) -> None:
    with WorkerLock(folder) as lock:
        child = os.fork()
        if child == 0:
            lock.release()  # as at the end of a with block
            time.sleep(60)
            os._exit(0)
        time.sleep(0.2)  # the child has released what it has
        names.put((lock.name, child))
        time.sleep(60)


def test_a_process_that_the_worker_forked_does_not_hold_its_lock(folder):
    names = FORK.Queue()
    process = FORK.Process(target=fork_and_hold, args=(folder, names))
    process.start()
    name, child = names.get(timeout=30)
    assert is_held(folder, name) is True
    process.kill()
    process.join()
    try:
        os.kill(child, 0)  # it lives
        assert is_held(folder, name) is False
    finally:
        os.kill(child, 9)


def test_those_who_look_at_once_do_not_take_each_other_for_the_worker(folder):
    name = killed_worker(folder)
    with lock_file(folder, name).open() as other:
        fcntl.flock(other, fcntl.LOCK_SH)  # as any of them does
        assert is_held(folder, name) is False


def test_a_worker_gets_its_lock_while_others_remove_what_is_not_held(folder):
    folder.workers_dir.mkdir(parents=True)
    over = threading.Event()

    def remove_all() -> None:
        while not over.is_set():
            for file in folder.workers_dir.iterdir():
                remove_dead(folder, file.stem)

    removers = [threading.Thread(target=remove_all) for _ in range(2)]
    for remover in removers:
        remover.start()
    try:
        for _ in range(300):
            with WorkerLock(folder) as lock:
                assert is_held(folder, lock.name) is True
    finally:
        over.set()
        for remover in removers:
            remover.join()


def count_up(file: Path, times: int) -> None:
    for _ in range(times):
        with exclusive(file.with_suffix(".lock")):
            number = int(file.read_text())
            time.sleep(0.001)  # long enough for another process to read the same
            file.write_text(str(number + 1))


def test_only_one_process_at_a_time_is_in_an_exclusive_block(tmp_path):
    file = tmp_path / "count"
    file.write_text("0")
    processes = [FORK.Process(target=count_up, args=(file, 20)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert file.read_text() == "60"


def test_an_exclusive_block_ends_with_an_error_too(tmp_path):
    with pytest.raises(KeyError, match="x"), exclusive(tmp_path / "lock"):
        raise KeyError("x")
    with exclusive(tmp_path / "lock"):
        pass


def test_a_place_for_no_files_is_refused(tmp_path):
    (tmp_path / "workers").write_text("a file")
    with pytest.raises(RunError, match="cannot be locked: File exists. Expected a folder on"):
        WorkerLock(StudyFolder(tmp_path)).acquire()
