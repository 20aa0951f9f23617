"""Jobs that are killed, interrupted, changed or fail: what is done stays, the rest goes on."""

import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import counting
import pytest
from counting import STEPS, die, jobs_in, log, refuse
from waiting import PATIENCE, wait_for

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.jobs import Here, Job, finish, map_jobs, open_executor, status
from sb3_piano.training.runs.provenance import provenance


def is_alive(pid):
    """Return whether a process runs; one that ended and was not waited for does not."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


def descendants(pid):
    """Return the processes that one has started, and those that they have."""
    texts = (file.read_text() for file in Path(f"/proc/{pid}/task").glob("*/children"))
    own = {int(number) for text in texts for number in text.split()}
    return own.union(*map(descendants, own))


@pytest.fixture
def program(tmp_path):
    """The program that counts, in a group of its own as from a terminal."""
    command = [sys.executable, counting.__file__, str(tmp_path)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, start_new_session=True, **pipes) as process:
        yield process
        process.kill()


def assert_done(folder):
    """All jobs have their results, and none was begun again once it had one."""
    assert [job.result() for job in jobs_in(folder)] == [{"steps": STEPS}] * 4
    assert not [path for path in folder.rglob("*") if path.suffix in (".lock", ".partial")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("moment", "whom", "number", "status_then"),
    [
        ("starts", "group", signal.SIGTERM, 130),
        ("counts", "parent", signal.SIGKILL, -signal.SIGKILL),
        ("counts", "parent", signal.SIGTERM, 130),
        ("counts", "group", signal.SIGINT, 130),
        ("counts", "worker", signal.SIGKILL, 0),
    ],
)
def test_whatever_ends_a_program_the_same_one_does_the_rest(
    program, tmp_path, moment, whom, number, status_then
):
    if moment == "starts":  # processes, which import nothing yet
        wait_for(lambda: len(descendants(program.pid)) == 2, program.poll)
    else:
        wait_for((tmp_path / "a" / "saved").exists, program.poll)
        wait_for((tmp_path / "b" / "saved").exists, program.poll)
    started = descendants(program.pid)
    victim = {"parent": program.pid, "group": -program.pid}.get(whom) or log(tmp_path)[0][2]
    os.kill(victim, number)
    out, err = program.communicate(timeout=PATIENCE)
    assert program.returncode == status_then, err
    assert "Traceback" not in err
    wait_for(lambda: not any(map(is_alive, started)))
    kept = {job.name for job in jobs_in(tmp_path) if job.result() is not None}
    before = len(log(tmp_path))
    if whom == "worker":  # the others, and what does not need its job, went on
        (lost,) = (line.split()[0] for line in out.splitlines() if " failed A worker " in line)
        assert kept == {"a": {"b"}, "b": {"a", "c", "d"}}[lost]
        assert "was ended by SIGKILL. What is whole is kept; go on" in out
    assert [one.state for one in finish(jobs_in(tmp_path), workers=2)] == ["finished"] * 4
    assert_done(tmp_path)
    resumed = log(tmp_path)[before:]
    assert {name for name, _, _ in resumed} == {*"abcd"} - kept
    assert Counter(name for name, _, _ in resumed).most_common(1)[0][1] == 1
    if moment == "counts":
        assert all(done > 0 for name, done, _ in resumed if name in "ab")


SLOW = """
import os, sys, time
from sb3_piano.jobs import open_executor
from sb3_piano.jobs.pool import start_process

class Slow:
    def __reduce__(self):
        return (exec, ("import os, time; open({mark!r} + str(os.getpid()), 'w').close()\\n"
                       "end = time.monotonic() + 60\\nwhile time.monotonic() < end: pass",))

if __name__ == "__main__":
    WORK
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "work",
    [
        "with open_executor(1) as pool: pool.submit(print, Slow()).result()",
        "start_process(print, Slow())",
    ],
    ids=["pool", "environments"],
)
def test_workers_that_still_import_end_with_a_parent_that_is_killed(tmp_path, work):
    program = tmp_path / "program.py"
    slow = SLOW.replace("{mark!r}", repr(f"{tmp_path}/pid-"))
    program.write_text(slow.replace("WORK", work))
    process = subprocess.Popen([sys.executable, program])
    wait_for(lambda: list(tmp_path.glob("pid-*")), process.poll)
    process.kill()
    process.wait()
    killed = time.monotonic()
    workers = [int(file.name[4:]) for file in tmp_path.glob("pid-*")]
    wait_for(lambda: not any(map(is_alive, workers)))
    assert time.monotonic() - killed < 10


def test_a_job_that_fails_stops_only_those_that_need_it(tmp_path):
    told, states = [], []

    def tell(*one):
        told.append(one)
        states.append([one.state for one in status(jobs_in(tmp_path))])  # also meanwhile

    found = finish(jobs_in(tmp_path, refuse), Here(), on_outcome=tell)
    assert states[1:3] == [["not begun", "finished", "not begun", "not begun"]] * 2
    assert [outcome.state for outcome in found] == ["failed", "finished", "failed", "failed"]
    assert found[0].reason == "steps is 60: expected fewer."
    assert isinstance(found[0].error, ConfigError)
    assert replace(found[0], error=MemoryError()).reason == "out of memory: MemoryError"
    assert [outcome.reason for outcome in found[2:]] == [
        "It needs 'a', which failed.",
        "It needs 'c', which failed.",
    ]
    assert [(one.job.name, *done) for one, *done in told] == [
        (name, number, 4) for number, name in enumerate("abcd", start=1)
    ]
    assert not (tmp_path / "a").exists()
    jobs_in(tmp_path, steps=10)[0].begin()  # a folder without work may have other settings
    assert [one.state for one in finish(jobs_in(tmp_path), Here())] == ["finished"] * 4
    assert_done(tmp_path)


@pytest.mark.slow
def test_a_process_that_dies_takes_only_its_own_job_with_it(tmp_path):
    with open_executor(1) as pool:
        found = finish(jobs_in(tmp_path, die), pool, go_on="once more.")
        assert [one.state for one in found] == ["failed", "finished", "failed", "failed"]
        assert isinstance(found[0].error, RunError)
        assert "without memory: process " in found[0].reason
        assert found[0].reason.endswith("with fewer workers if need be: once more.")
        finish(jobs_in(tmp_path, die), pool)
        with pytest.raises(RunError, match="A worker ended before .* with status 9.*: again"):
            list(map_jobs(pool, os._exit, [9], go_on="again"))
    assert_done(tmp_path)


def test_other_settings_than_those_of_before_are_refused_and_the_first_is_named(tmp_path):
    (job, *_) = jobs_in(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        finish([replace(job, work=interrupt)], Here())
    for changed, told in (
        ({"steps": 61}, "steps 60, not 61"),
        ({"of": {"name": "x"}}, "of.name a, not x"),
    ):
        other = replace(job, settings={**job.settings, **changed})
        with pytest.raises(RunError, match=f"The job 'a' in '.*' has {told}: expected the same"):
            finish([other], Here())
    assert not log(tmp_path)
    assert finish([job], Here())[0].result == {"steps": STEPS}
    (job.folder / "result.json").write_text("{")
    with pytest.raises(RunError, match=r"result.json' cannot be read .*: delete it, and"):
        finish([job], Here())


def interrupt(job):
    (job.folder / "begun").touch()
    raise KeyboardInterrupt


def test_a_folder_with_anything_else_is_refused_and_left_alone(tmp_path):
    (job, *_) = jobs_in(tmp_path)
    job.folder.mkdir()
    (job.folder / "notes.txt").write_text("mine")
    (found,) = finish([job], Here())
    assert "is not empty: expected a new or empty one." in found.reason
    assert [path.name for path in job.folder.iterdir()] == ["notes.txt"]


def test_needs_are_jobs_before_and_names_differ(tmp_path):
    a, b, *_ = jobs_in(tmp_path)
    for changed, told in (({"needs": ("b",)}, "needs 'b'"), ({"name": "b"}, "has the name of")):
        with pytest.raises(ConfigError, match=f"Job '[ab]' {told}.*: expected names that differ"):
            finish([replace(a, **changed), b], Here())
    assert not log(tmp_path)


@pytest.mark.slow
def test_a_second_process_waits_for_the_first_and_does_not_do_it_again(tmp_path):
    (job, *_) = jobs_in(tmp_path, pause=0.02)
    with open_executor(2) as pool:
        both = [pool.submit(Job.do, job) for _ in range(2)]
        assert [one.result() for one in both] == [{"steps": STEPS}] * 2
    assert len(log(tmp_path)) == 1


def begin_and_wait(file):
    with stop_on_signal() as request:
        file.write_text(str(os.getpid()))
        while not request.made:
            time.sleep(0.01)
    raise KeyboardInterrupt


@pytest.mark.slow
def test_a_pool_that_ends_begins_none_of_the_jobs_that_it_was_given(tmp_path):
    files = [tmp_path / str(number) for number in range(3)]
    request = StopRequest()

    def stop():
        wait_for(files[0].exists)
        request.made = True

    thread = threading.Thread(target=stop)
    thread.start()
    with pytest.raises(KeyboardInterrupt), open_executor(1) as pool:
        next(map_jobs(pool, begin_and_wait, files, request))
    thread.join()
    assert [file.exists() for file in files] == [True, False, False]
    with pytest.raises(ProcessLookupError):  # which a pool waits for
        os.kill(int(files[0].read_text()), 0)


def test_no_job_begins_after_a_signal(tmp_path):
    begun = []

    def begin(job):
        begun.append(job.name)
        if job.name == "b":
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(KeyboardInterrupt):
        finish(jobs_in(tmp_path), Here(), on_begin=begin)
    assert begun == ["a", "b"]
    assert [name for name, _, _ in log(tmp_path)] == ["a"]


@pytest.mark.slow
def test_workers_begin_at_once_after_the_server_that_forks_them_was_killed():
    for number in range(2):
        with open_executor(1) as pool:
            server = pool.submit(os.getppid).result()
        os.kill(server, signal.SIGKILL)
        with open_executor(1) as pool:
            assert pool.submit(abs, -number).result() == number


@pytest.mark.slow
def test_on_a_cluster_jobs_of_a_node_that_dies_go_on_elsewhere(ray_cluster, tmp_path):
    ray = pytest.importorskip("ray")
    ray.cloudpickle.register_pickle_by_value(counting)  # which the nodes do not have
    jobs = jobs_in(tmp_path, pause=0.05)

    def both_nodes_count():  # each has one core: two jobs that have saved and not finished
        saved = {path.parent for path in tmp_path.glob("*/saved")}
        return len(saved - {path.parent for path in tmp_path.glob("*/result.json")}) == 2

    def kill():
        wait_for(both_nodes_count)
        ray_cluster.remove_node(next(iter(ray_cluster.worker_nodes)), allow_graceful=False)

    killer = threading.Thread(target=kill)
    killer.start()
    with open_executor(ray=ray_cluster.address) as executor:
        found = finish(jobs, executor)
    killer.join()
    ray_cluster.add_node(num_cpus=1, node_ip_address="127.0.0.1", object_store_memory=2**27)
    ray.cloudpickle.unregister_pickle_by_value(counting)
    assert [one.state for one in found] == ["finished"] * 4
    assert_done(tmp_path)
    assert sum(done > 0 for _, done, _ in log(tmp_path)) == 1
    assert len(log(tmp_path)) == 5


SERVED_BEFORE = """
import multiprocessing
import torch
context = multiprocessing.get_context("forkserver")
context.set_forkserver_preload(["torch"])
first = context.Process(target=print)
first.start()
first.join()
from sb3_piano.jobs import open_executor
with open_executor(1) as executor:
    print("threads", executor.submit(torch.get_num_threads).result())
"""


@pytest.mark.slow
def test_a_worker_computes_in_one_thread_even_if_others_started_the_server_of_processes():
    environment = {k: v for k, v in os.environ.items() if k != "OMP_NUM_THREADS"}
    program = [sys.executable, "-c", SERVED_BEFORE]
    done = subprocess.run(program, capture_output=True, text=True, env=environment)
    assert "threads 1" in done.stdout, done.stderr


def test_runs_of_a_worker_name_the_command_that_the_user_gave():
    with open_executor(1) as executor:
        assert executor.submit(provenance, 0).result()["command"] == shlex.join(sys.orig_argv)
