"""Processes of this machine that do jobs."""

from __future__ import annotations

import os
import time

import pytest

from sb3_piano.executors import process_pool


@pytest.mark.slow
def test_processes_end_with_their_pool_whatever_they_are_at():
    with process_pool(1) as pool:
        process = pool.submit(os.getpid).result()
        pool.submit(time.sleep, 600)
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
