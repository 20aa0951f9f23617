"""Waiting for other processes and threads."""

import time

PATIENCE = 600  # s; starting several processes takes minutes where many others are at work


def wait_for(condition, status=lambda: None, seconds=PATIENCE):
    """Wait until a condition is met; ``status`` returns the exit status of a process that ended."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert status() is None, "the process has ended"
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.02)
