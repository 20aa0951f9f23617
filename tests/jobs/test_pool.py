"""Processes of this machine that do jobs."""

import multiprocessing.util
import os
import threading
import time

import pytest

from sb3_piano.exceptions import RunError
from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.jobs import map_jobs, open_executor


@pytest.mark.slow
def test_processes_end_with_their_pool_whatever_they_are_at():
    with open_executor(1) as pool:
        process = pool.submit(os.getpid).result()
        pool.submit(time.sleep, 600)
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def begin_and_wait(file):
    with stop_on_signal() as request:
        file.touch()
        while not request.made:
            time.sleep(0.01)
    raise KeyboardInterrupt


@pytest.mark.slow
def test_a_killed_worker_is_told_in_a_line_and_leaves_no_folder():
    folders = []

    def be_killed():
        with open_executor(1) as pool:
            folders.append(pool.submit(multiprocessing.util.get_temp_dir).result())
            list(map_jobs(pool, os._exit, [9], go_on="again"))

    with pytest.raises(RunError, match="A worker ended before .*: again"):
        be_killed()
    assert folders == [multiprocessing.util.get_temp_dir()]


@pytest.mark.slow
def test_a_pool_that_ends_begins_none_of_the_jobs_that_it_was_given(tmp_path):
    files = [tmp_path / str(number) for number in range(3)]
    request = StopRequest()

    def stop():
        while not files[0].exists():
            time.sleep(0.01)
        request.made = True

    thread = threading.Thread(target=stop)
    thread.start()
    with pytest.raises(KeyboardInterrupt), open_executor(1) as pool:
        next(map_jobs(pool, begin_and_wait, files, request))
    thread.join()
    assert [file.exists() for file in files] == [True, False, False]
