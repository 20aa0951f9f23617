"""`make check` leaves out the slow tests, and still runs some of each room."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parent


@pytest.mark.slow
def test_each_folder_has_fast_tests():
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-m", "not slow", TESTS]
    done = subprocess.run(command, cwd=TESTS.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    files = [line.partition("::")[0] for line in done.stdout.splitlines() if "::" in line]
    fast = {(TESTS.parent / file).parent.name for file in files}
    assert {file.parent.name for file in TESTS.glob("*/test_*.py")} <= fast
