"""One process at a time holds a lock, for as long as it lives."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from pathlib import Path

import pytest

from sb3_piano.exceptions import RunError
from sb3_piano.locks import hold

FORK = multiprocessing.get_context("fork")


def is_held(path: Path) -> bool:
    try:
        with hold(path, busy="busy"):
            return False
    except RunError:
        return True


def hold_long(path: Path, said) -> None:
    with hold(path):
        said.put(os.getpid())
        time.sleep(60)


def run_and_kill(target, path: Path):
    """Run a function in a process, kill that once it has said something, and return that."""
    said = FORK.Queue()
    process = FORK.Process(target=target, args=(path, said))
    process.start()
    answer = said.get(timeout=30)
    assert is_held(path)
    process.kill()
    process.join()
    return answer


def count_up(file: Path, times: int) -> None:
    for _ in range(times):
        with hold(file.with_suffix(".lock")):
            number = int(file.read_text())
            time.sleep(0.001)  # long enough for another process to read the same
            file.write_text(str(number + 1))


def test_only_one_process_at_a_time_holds_a_lock(tmp_path):
    file = tmp_path / "count"
    file.write_text("0")
    processes = [FORK.Process(target=count_up, args=(file, 8)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert file.read_text() == "24"


def test_a_lock_is_given_back_after_an_error_too_and_leaves_no_file(tmp_path):
    path = tmp_path / "folder" / "lock"
    with pytest.raises(KeyError, match="x"), hold(path):
        raise KeyError("x")
    assert not path.exists()
    assert not is_held(path)


def test_who_does_not_wait_is_told_who_holds_it(tmp_path):
    with (
        hold(tmp_path / "lock"),
        pytest.raises(RunError, match=f"it is held by process {os.getpid()} on .*: expected one"),
        hold(tmp_path / "lock", "it is held", "one."),
    ):
        raise AssertionError("not refused")


def test_the_lock_of_a_killed_process_is_free_but_its_file_is_there(tmp_path):
    path = tmp_path / "lock"
    run_and_kill(hold_long, path)
    assert path.exists()
    assert not is_held(path)


def fork_and_hold(path: Path, said) -> None:
    with hold(path):
        child = os.fork()
        if child == 0:
            return  # from the with block; the lock is its parent's
        time.sleep(0.2)  # the child has left the block
        said.put(child)
        time.sleep(60)


def fork_and_stay(path: Path, said) -> None:
    with hold(path):
        child = os.fork()
        if child != 0:
            said.put(child)
        time.sleep(60)


def test_a_forked_process_neither_gives_the_lock_back_nor_holds_it_after_its_parent(tmp_path):
    run_and_kill(fork_and_hold, tmp_path / "lock")
    child = run_and_kill(fork_and_stay, tmp_path / "other")
    try:
        os.kill(child, 0)  # it lives
        assert not is_held(tmp_path / "other")
    finally:
        os.kill(child, signal.SIGKILL)


def test_a_place_for_no_files_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match="cannot be locked: .* Expected a folder on a disk"):
        hold(tmp_path / "file" / "lock").__enter__()
