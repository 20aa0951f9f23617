"""Sweeps: cells are ordinary runs, begun, gone on with and judged wherever they are."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import json
import os
import re
import shutil
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import gymnasium as gym
import pytest
import torch
import yaml
from stable_baselines3 import TD3

from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import load_score, write_midi
from sb3_piano.sweeps import SweepConfig, load_sweep, sweep, sweep_status
from sb3_piano.sweeps.cells import finish_cell, status_of
from sb3_piano.sweeps.storage import Mirror
from sb3_piano.sweeps.sweep import jobs_of
from sb3_piano.training import resume
from sb3_piano.training.runs.builders import build_model, build_vec_env

SHORT = {
    "algos": ("td3",),
    "envs": ("RoboPianist-debug-CMajorChordProgressionTwoHands-v0",),
    "settings": {
        "n_timesteps": 220,
        "learning_starts": 100,
        "batch_size": 32,
        "policy_kwargs": {"net_arch": [16]},
        "env_kwargs": {"physics": "fast"},
        "callback": [],
    },
    "checkpoint_every": 60,
}


def here():
    """Return an executor of this process."""
    return ThreadPoolExecutor(1)


def weights(folder):
    return TD3.load(Path(folder) / "model.zip", device="cpu").policy.state_dict()


def assert_same_weights(folder, other):
    found, expected = weights(folder), weights(other)
    assert found.keys() == expected.keys()
    assert all(torch.equal(found[name], expected[name]) for name in found)


def test_cells_are_all_combinations():
    config = SweepConfig(
        algos=("td3", "sac"),
        pieces=("scale-CMajor", "hanon-01"),
        variants={"plain": {}, "discount": {"gamma": 0.5, "n_timesteps": 7}},
        settings={"n_timesteps": 9},
        seeds=(0, 3),
    )
    runs = config.runs()
    assert len(runs) == 16
    run = runs["sac_hanon-01_discount", 3]
    assert (run.algo, run.seed, run.n_timesteps) == ("sac", 3, 7)
    assert run.algorithm_kwargs["gamma"] == 0.5
    assert run.env_kwargs["score"] == "hanon-01"
    assert runs["td3_scale-CMajor_plain", 0].n_timesteps == 9


def test_options_of_environments_are_added_to_each_other():
    config = SweepConfig(
        pieces=("hanon-01",),
        settings={"env_kwargs": "dict(observation='fingers', physics='reference', score='a')"},
        variants={"fast": {"env_kwargs": {"physics": "fast"}}},
    )
    (run,) = config.runs().values()
    assert run.env_kwargs == {"observation": "fingers", "physics": "fast", "score": "hanon-01"}


@pytest.mark.slow
def test_every_cell_of_the_page_can_be_trained(tmp_path, monkeypatch):
    page = Path(__file__).parents[2].joinpath("docs", "sweeps.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    Path("sweep.yml").write_text(re.search(r"```yaml\n(.*?)```", page, re.S)[1], "utf-8")
    write_midi(load_score("scale-CMajor"), "my.mid")
    runs = load_sweep("sweep.yml").runs()
    assert len(runs) == 2 * 4 * 2 * 3
    for (_, seed), run in runs.items():
        if seed == 0:  # from the others it is the same
            small = {**run.algorithm_kwargs, "buffer_size": 10}
            run = dataclasses.replace(run, algorithm_kwargs=small)
            with contextlib.closing(build_vec_env(run)) as venv:
                build_model(run, venv)
                venv.reset()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"envs": ()}, "neither pieces nor envs"),
        ({"algos": ()}, r"algos is \(\): expected at least one entry\."),
        ({"seed": (0,)}, "Unknown setting 'seed' of SweepConfig"),
        ({"resources": {"num_cpus": -1}}, "num_cpus is -1"),
        ({"seeds": (0, 0)}, "Two cells of the sweep"),
        ({"variants": {}}, r"variants is \{\}: expected at least one entry\."),
        ({"settings": {"env_kwargs": 3}}, "Cell 'td3_RoboPianist-debug.*env_kwargs is 3"),
        ({"settings": {"gamma": 7.0, "n_timesteps": 0}}, "Cell 'td3_RoboPianist-debug"),
    ],
)
def test_what_is_wrong_with_a_grid_is_told(changed, told):
    with pytest.raises(ConfigError, match=told):
        SweepConfig(**{**SHORT, **changed}).runs()


def test_a_cell_that_a_callback_ended_is_finished(tmp_path):
    judge = {"sb3_piano.callbacks.F1Callback": {"eval_freq": 10, "stop_threshold": 0.0}}
    settings = {**SHORT["settings"], "callback": [judge]}
    found = []
    config = SweepConfig(**{**SHORT, "settings": settings})
    for _ in range(2):
        with here() as executor:
            result = sweep(
                config,
                tmp_path / "sweep",
                executor=executor,
                on_result=lambda cell, *_: found.append(cell),
            )
        assert [cell.num_timesteps for cell in result.cells] == [10]
    assert len(found) == 1  # the second call has nothing to do
    (state,) = sweep_status(config, tmp_path / "sweep")
    assert state.metrics == found[0].metrics
    longer = SweepConfig(**{**SHORT, "settings": {**settings, "n_timesteps": 230}})
    (job,) = jobs_of(longer, tmp_path / "sweep")
    assert not status_of(job).finished


def test_the_file_is_named_when_a_setting_is_wrong(tmp_path):
    file = tmp_path / "grid.yml"
    file.write_text(yaml.safe_dump({"algos": ["td3"], "envs": ["x"], "seeds": ["one"]}))
    with pytest.raises(ConfigError, match=r"grid\.yml': seeds"):
        load_sweep(file)


@pytest.mark.slow
def test_a_sweep_ends_goes_on_and_has_results(tmp_path):
    """One folder sees all: a run that had stopped, one that fails, a changed grid, a longer one."""
    place = tmp_path / "sweep"
    good = SweepConfig(**SHORT)
    (job,) = jobs_of(good, place)
    # The run had stopped after its second checkpoint.
    shorter = SweepConfig(**{**SHORT, "settings": {**SHORT["settings"], "n_timesteps": 120}})
    assert finish_cell(jobs_of(shorter, place)[0]).finished
    shutil.copytree(job.folder, tmp_path / "alone")

    both = SweepConfig(**{**SHORT, "variants": {"": {}, "odd": {"train_freq": [1, "episode"]}}})
    with here() as executor, pytest.raises(RunError, match="not empty and no sweep"):
        sweep(good, place, executor=executor)
    (place / "sweep.yml").write_text("{}", encoding="utf-8")
    told = []
    with here() as executor:
        result = sweep(
            both, place, executor=executor, on_result=lambda cell, done, total: told.append(done)
        )
    first = result.cells[0]
    assert first.started_at == 120
    assert first.num_timesteps == 220
    judged = Path(first.folder, "evaluation", "metrics.json").read_bytes()
    assert json.loads(judged)["num_timesteps"] == 220  # of the last model, not of the 120 steps
    assert told == [1, 2]
    assert all(cell.finished for cell in result.cells)

    resume(tmp_path / "alone", 220, progress_bar=False, checkpoint_every=60)
    assert_same_weights(first.folder, tmp_path / "alone")

    with (place / "results.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["state"] for row in rows] == ["finished", "finished"]
    assert float(rows[0]["f1"]) == first.metrics["f1"]

    before = Path(first.folder, "model.zip").stat().st_mtime_ns
    with here() as executor:
        again = sweep(both, place, executor=executor, on_result=lambda *_: pytest.fail("a run"))
    assert [cell.metrics for cell in again.cells] == [cell.metrics for cell in result.cells]
    assert Path(first.folder, "model.zip").stat().st_mtime_ns == before

    changed = SweepConfig(**{**SHORT, "settings": {**SHORT["settings"], "gamma": 0.5}})
    with here() as executor, pytest.raises(RunError, match="other settings than when it was begun"):
        sweep(changed, place, executor=executor)


@pytest.mark.slow
def test_a_cell_that_fails_does_not_stop_the_others(tmp_path, capsys):
    grid = {
        **SHORT,
        "algos": ["td3"],
        "envs": list(SHORT["envs"]),
        "variants": {
            "bad": {"env_kwargs": {"score": str(tmp_path / "gone.mid")}},
            "good": {},
        },
    }
    file = tmp_path / "grid.yml"
    file.write_text(yaml.safe_dump(grid), encoding="utf-8")
    status = main(
        ["sweep", str(file), "--run", str(tmp_path / "sweep"), "--workers", "1", "--no-progress"]
    )
    told = capsys.readouterr()
    assert status == 2
    assert "gone.mid" in told.err
    states = [cell.state for cell in sweep_status(load_sweep(file), tmp_path / "sweep")]
    assert states == ["not begun", "finished"]


class Stopped(gym.Wrapper):
    """Press Ctrl-C in the second episode that is judged; named in a config by its import path."""

    episodes = 0

    def reset(self, **kwargs):
        self.episodes += 1
        return self.env.reset(**kwargs)

    def step(self, action):
        # Resting hands and the first episode each end with a reset that begins the next one.
        if self.episodes == 4 and Path("ctrl-c").exists():
            Path("ctrl-c").unlink()
            os.kill(os.getpid(), signal.SIGINT)
        return self.env.step(action)


def test_an_evaluation_that_is_interrupted_leaves_its_cell_unfinished(
    tmp_path, monkeypatch, ctrl_c
):
    monkeypatch.chdir(tmp_path)
    settings = {**SHORT["settings"], "env_wrapper": f"{__name__}.Stopped", "n_timesteps": 1}
    config = SweepConfig(**{**SHORT, "settings": settings, "episodes": 3})
    (job,) = jobs_of(config, tmp_path / "sweep")
    Path("ctrl-c").touch()
    with pytest.raises(KeyboardInterrupt):
        finish_cell(job)
    assert not Path("ctrl-c").exists()
    file = Path(job.folder, "evaluation", "metrics.json")
    assert len(json.loads(file.read_text())["episodes"]) == 1
    assert status_of(job).state == "1 of 1 steps"
    assert finish_cell(job).finished


@pytest.mark.slow
def test_on_object_storage_a_cell_goes_on_from_the_last_whole_copy(tmp_path):
    url = f"local://{tmp_path / 'bucket'}"
    shorter = SweepConfig(**{**SHORT, "settings": {**SHORT["settings"], "n_timesteps": 120}})
    (job,) = jobs_of(shorter, tmp_path / "sweep", url)
    assert finish_cell(job).num_timesteps == 120
    kept = tmp_path / "bucket" / job.folder.removeprefix(url).strip("/")
    assert len(list(kept.glob("copy-*"))) == 1
    assert status_of(job).finished
    more = dataclasses.replace(job, episodes=2)
    assert (status_of(more).finished, status_of(more).num_timesteps) == (False, 120)
    (kept / "copy-99").mkdir()  # of a process that died while it copied
    (longer,) = jobs_of(SweepConfig(**SHORT), tmp_path / "sweep", url)
    assert status_of(longer).state == "120 of 220 steps"
    result = finish_cell(longer)
    assert (result.started_at, result.num_timesteps) == (120, 220)
    newest = kept / (kept / "current").read_text(encoding="utf-8")
    assert Checkpoint.read(newest / "checkpoint").num_timesteps == 220


def test_copies_that_a_process_left_which_died_are_deleted(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "file").write_text("new")
    bucket = tmp_path / "bucket"
    for name in ("copy-3", "copy-5", "copy-7"):
        (bucket / name).mkdir(parents=True)
    (bucket / "current").write_text("copy-5")
    mirror = Mirror(tmp_path / "run", f"local://{bucket}")
    mirror.fetch()
    for number, newer in ((6, {"copy-7"}), (7, set())):  # that may be under way elsewhere
        mirror.store()
        assert {path.name for path in bucket.iterdir()} == {f"copy-{number}", "current", *newer}
        assert (bucket / (bucket / "current").read_text() / "file").read_text() == "new"


@pytest.mark.slow
def test_a_node_that_dies_loses_no_cell(ray_cluster, tmp_path):
    """Four cells on two nodes; one is killed while both train what they have checkpoints of.

    Each cell finishes once, that of the dead node from its checkpoint, and those that were not
    interrupted have the weights of local ones.
    """
    longer = {**SHORT, "settings": {**SHORT["settings"], "n_timesteps": 320}}
    config = SweepConfig(**{**longer, "seeds": tuple(range(4))})
    place, found = tmp_path / "cluster", []

    def steps():
        for file in place.glob("*/seed_*/checkpoint/checkpoint.json"):
            with contextlib.suppress(FileNotFoundError):  # as it is replaced
                yield json.loads(file.read_bytes())["num_timesteps"]

    def kill():
        deadline = time.monotonic() + 200
        while sum(done < 220 for done in steps()) < 2 and time.monotonic() < deadline:
            time.sleep(0.02)
        ray_cluster.remove_node(next(iter(ray_cluster.worker_nodes)), allow_graceful=False)

    killer = threading.Thread(target=kill)
    killer.start()
    result = sweep(
        config, place, ray=ray_cluster.address, on_result=lambda cell, *_: found.append(cell)
    )
    killer.join()
    ray_cluster.add_node(num_cpus=1, node_ip_address="127.0.0.1", object_store_memory=2**27)
    assert sorted(cell.seed for cell in found) == list(range(4))
    assert all(cell.finished for cell in result.cells), [cell.error for cell in result.cells]
    assert len([cell for cell in result.cells if cell.started_at > 0]) == 1
    untouched = next(cell for cell in result.cells if cell.started_at == 0)
    with here() as executor:
        (expected,) = sweep(
            SweepConfig(**{**longer, "seeds": (untouched.seed,)}),
            tmp_path / "local",
            executor=executor,
        ).cells
    assert untouched.metrics == expected.metrics
    assert_same_weights(untouched.folder, expected.folder)
