"""A cluster of Ray as an executor: what becomes of jobs, their errors, and nodes that die."""

from __future__ import annotations

import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from waiting import wait_for

from sb3_piano.exceptions import ConfigError
from sb3_piano.jobs import cluster, map_jobs, open_executor

ray = pytest.importorskip("ray")

pytestmark = pytest.mark.slow


def _square(number: int) -> int:
    return number**2


def _refuse(number: int) -> None:
    raise ConfigError(f"number is {number}: expected another one.")


def _die_once(file: Path) -> str:
    if not file.exists():
        file.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "ended"


def _sleep(file: Path) -> None:
    try:
        file.touch()  # from here on Ctrl-C may come
        for _ in range(600):
            time.sleep(0.1)  # which Ray does not interrupt, so that it must not be long
    except KeyboardInterrupt:
        file.write_text("told", encoding="utf-8")


@pytest.fixture
def address(ray_cluster) -> Iterator[str]:
    this = sys.modules[__name__]
    ray.cloudpickle.register_pickle_by_value(this)  # which the nodes do not have
    yield ray_cluster.address
    ray.cloudpickle.unregister_pickle_by_value(this)


def test_jobs_in_the_present_folder_give_results_and_errors_and_are_begun_again_if_killed(
    address, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # where the nodes were not started
    with open_executor(ray=address) as executor:
        assert sorted(map_jobs(executor, _square, range(5))) == [0, 1, 4, 9, 16]
        assert executor.submit(os.getcwd).result() == str(tmp_path)
        assert executor.submit(_die_once, tmp_path / "begun").result() == "ended"
        error = executor.submit(_refuse, 3).exception()
    assert type(error) is ConfigError
    assert str(error) == "number is 3: expected another one."


def test_jobs_that_run_when_the_block_ends_get_ctrl_c(address, tmp_path):
    file = tmp_path / "begun"
    with open_executor(ray=address) as executor:
        executor.submit(_sleep, file)
        wait_for(file.exists)
    assert file.read_text(encoding="utf-8") == "told"


@pytest.mark.parametrize("scheme", ["", "ray://"])
def test_a_port_where_nobody_listens_is_told_at_once(scheme):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with (
        pytest.raises(ConfigError, match=rf"No cluster of Ray .*:{port}' \(.*refused\)"),
        open_executor(ray=f"{scheme}127.0.0.1:{port}"),
    ):
        pass


def test_processes_and_a_cluster_at_once_are_refused():
    with (
        pytest.raises(ConfigError, match="workers is 2 with ray 'auto': expected one"),
        open_executor(workers=2, ray="auto"),
    ):
        pass


def test_a_job_can_get_ctrl_c_where_its_node_has_it_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        found = cluster._call(os.getcwd(), signal.getsignal, (signal.SIGINT,), {})
        assert found is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
