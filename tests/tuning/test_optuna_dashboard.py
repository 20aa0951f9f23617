"""``optuna-dashboard`` serves a study from its journal."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import optuna
import pytest
from finished_study import finished_study, study_config

from sb3_piano.tuning.storage import open_storage
from sb3_piano.tuning.study import StudyFolder

pytest.importorskip("optuna_dashboard")

COMMAND = Path(sys.executable).with_name("optuna-dashboard")
PATIENCE = 120
"""Seconds in which the server has to answer, on the busiest of machines."""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def dashboard(journal, log):
    """Run the command; yield a function that fetches JSON from it."""
    port = free_port()
    command = [str(COMMAND), str(journal), "--port", str(port)]
    with log.open("w") as output, subprocess.Popen(command, stdout=output, stderr=output) as server:

        def fetch(path):
            with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=30) as answer:
                return json.load(answer)

        try:
            for _ in range(10 * PATIENCE):
                assert server.poll() is None, log.read_text()
                with contextlib.suppress(OSError):
                    fetch("/api/meta")
                    break
                time.sleep(0.1)
            yield fetch
        finally:
            server.terminate()


@pytest.mark.slow
def test_the_dashboard_shows_a_study_that_is_in_a_journal(tmp_path):
    folder = StudyFolder(tmp_path / "study")
    folder.path.mkdir()
    config = study_config()
    study = finished_study(config, storage=open_storage(None, folder), n_complete=5)
    with dashboard(folder.journal_file, tmp_path / "log.txt") as fetch:
        (listed,) = fetch("/api/studies")["study_summaries"]
        details = fetch(f"/api/studies/{listed['study_id']}")
    assert listed["study_name"] == "sac_twinkle"
    assert listed["directions"] == ["maximize"]
    numbers = {trial["number"]: trial for trial in details["trials"]}
    assert len(numbers) == len(study.trials)
    for trial in study.get_trials(states=(optuna.trial.TrialState.COMPLETE,)):
        assert numbers[trial.number]["state"] == "Complete"
        assert numbers[trial.number]["values"] == [trial.value]
    assert {"Complete", "Pruned", "Fail", "Running", "Waiting"} == {
        trial["state"] for trial in details["trials"]
    }
    (preset,) = [a["value"] for a in numbers[0]["user_attrs"] if a["key"] == "origin"]
    assert preset == "preset"
