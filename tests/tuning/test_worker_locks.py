"""A worker's lock tells others whether it lives."""

from __future__ import annotations

import multiprocessing
import os
import socket
import threading
import time

import pytest

from sb3_piano.exceptions import RunError
from sb3_piano.locks import hold
from sb3_piano.tuning.store.locks import (
    any_held,
    dead_workers,
    is_held,
    remove_dead,
    worker_lock,
)
from sb3_piano.tuning.study_folder import StudyFolder

FORK = multiprocessing.get_context("fork")


@pytest.fixture
def folder(tmp_path) -> StudyFolder:
    return StudyFolder(tmp_path / "study")


def live(folder: StudyFolder, names) -> None:
    with worker_lock(folder) as name:
        names.put(name)
        time.sleep(60)


def killed_worker(folder: StudyFolder) -> str:
    names = FORK.Queue()
    process = FORK.Process(target=live, args=(folder, names))
    process.start()
    name = names.get(timeout=30)
    assert is_held(folder, name) is True
    process.kill()
    process.join()
    return name


def test_a_lock_is_held_while_its_worker_lives_and_leaves_no_file(folder):
    with worker_lock(folder) as name:
        assert is_held(folder, name) is True
    assert is_held(folder, name) is None
    assert list(folder.workers_dir.iterdir()) == []


def test_a_name_says_host_and_process_and_is_like_no_other(folder):
    with worker_lock(folder) as name, worker_lock(folder) as other:
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
    with worker_lock(folder) as name:
        remove_dead(folder, name)
        assert is_held(folder, name) is True
        assert dead_workers(folder) == []


def test_any_held_leaves_out_the_dead_and_locks_of_another_kind(folder):
    killed_worker(folder)
    with hold(folder.workers_dir / "claim.lock"):
        assert not any_held(folder)
        with worker_lock(folder):
            assert any_held(folder)
    assert any_held(StudyFolder(folder.path / "elsewhere")) is False


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
            with worker_lock(folder) as name:
                assert is_held(folder, name) is True
    finally:
        over.set()
        for remover in removers:
            remover.join()


def test_a_place_for_no_files_is_refused(tmp_path):
    (tmp_path / "workers").write_text("a file")
    with pytest.raises(RunError, match="cannot be locked: File exists. Expected a folder on"):
        worker_lock(StudyFolder(tmp_path)).__enter__()
