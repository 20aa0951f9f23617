"""Workers of a study that are actors on a cluster of Ray."""

from __future__ import annotations

import functools
import os
import signal

import pytest
import small_study
from optuna.trial import TrialState

from sb3_piano.jobs import connected_to_ray
from sb3_piano.tuning import StudyFolder
from sb3_piano.tuning.storage import open_storage, open_study
from sb3_piano.tuning.team import Team
from sb3_piano.tuning.trials import repeated
from sb3_piano.tuning.workers import ActorWorker, ProcessWorker

pytestmark = pytest.mark.slow

CONFIG = small_study.small_study(entry={"n_timesteps": 150})


def run(folder, make_worker, on_progress=lambda trials: None):
    """Run two trials, one after the other; return their values by their settings, and the study."""
    folder.workers_dir.mkdir(parents=True)
    study = open_study(CONFIG, open_storage(None, folder), name="small")
    study.enqueue_trial({"gamma": 0.75})  # beside the one with the settings of the preset
    team = Team(
        study,
        CONFIG,
        folder,
        heart=None,
        n_trials=2,
        n_workers=1,
        make_worker=make_worker,
    )
    assert not team.run(on_progress)
    complete = [trial for trial in study.trials if trial.state is TrialState.COMPLETE]
    return {trial.params["gamma"]: trial.value for trial in complete}, study


def test_actors_do_what_processes_do_and_the_trial_of_a_dead_one_is_run_again(
    ray_cluster, tmp_path
):
    folder, killed = StudyFolder(tmp_path / "cluster"), []

    def kill_once(trials):
        if not killed and (folder.trial_dir(0) / "seed_0" / "run.yml").exists():
            (log,) = folder.workers_dir.glob("*.log")
            killed.append(int(log.stem.rpartition("-")[2]))
            os.kill(killed[0], signal.SIGKILL)

    with connected_to_ray(ray_cluster.address) as ray:
        found, study = run(folder, functools.partial(ActorWorker, ray), kill_once)
    assert killed
    assert repeated(study.trials) == {0}
    assert [trial.state for trial in study.trials].count(TrialState.FAIL) == 1
    assert len(found) == 2
    assert found == run(StudyFolder(tmp_path / "here"), ProcessWorker)[0]
