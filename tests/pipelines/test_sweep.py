"""Sweeps: cells are ordinary runs, begun, gone on with and judged wherever they are."""

import contextlib
import csv
import dataclasses
import json
import re
import shutil
import statistics
from pathlib import Path

import pytest
import torch
import yaml
from acting import parameters
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.jobs import Here, Job, status
from sb3_piano.music import load_score, write_midi
from sb3_piano.pipelines import SweepConfig, TrainingJob, load_sweep, sweep
from sb3_piano.training import RunFolder, evaluate, resume
from sb3_piano.training.runs.builders import build_model, build_vec_env

tables = Tables(__file__)

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


def runs_of(config):
    return {job.name: job.config for job in config.jobs(Path("sweep"))}


DISCOUNT = {"gamma": 0.5, "n_timesteps": 7, "env_kwargs": {"physics": "fast"}}


def test_cells_are_all_combinations():
    config = SweepConfig(
        algos=("td3", "sac"),
        pieces=("scale-CMajor", "hanon-01"),
        variants={"plain": {}, "discount": DISCOUNT},
        settings={"n_timesteps": 9, "env_kwargs": "dict(physics='reference', score='a', tempo=80)"},
        seeds=(0, 3),
    )
    runs = runs_of(config)
    assert len(runs) == 16
    run = runs["sac_hanon-01_discount/seed_3"]
    assert (run.algo, run.seed, run.n_timesteps) == ("sac", 3, 7)
    assert run.algorithm_kwargs["gamma"] == 0.5
    # Options of environments are added to each other.
    assert run.env_kwargs == {"tempo": 80, "physics": "fast", "score": "hanon-01"}
    assert runs["td3_scale-CMajor_plain/seed_0"].n_timesteps == 9


@pytest.mark.slow
def test_every_cell_of_the_page_can_be_trained(tmp_path, monkeypatch):
    page = Path(__file__).parents[2].joinpath("docs", "sweeps.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    Path("sweep.yml").write_text(re.search(r"```yaml\n(.*?)```", page, re.S)[1], "utf-8")
    write_midi(load_score("scale-CMajor"), "my.mid")
    runs = runs_of(load_sweep("sweep.yml"))
    assert len(runs) == 2 * 4 * 2 * 3
    for name, run in runs.items():
        if name.endswith("/seed_0"):  # from the others it is the same
            small = {**run.algorithm_kwargs, "buffer_size": 10}
            run = dataclasses.replace(run, algorithm_kwargs=small)
            with contextlib.closing(build_vec_env(run)) as venv:
                build_model(run, venv)
                venv.reset()


@tables("changed, told")
def test_what_is_wrong_with_a_grid_is_told(changed, told):
    with pytest.raises(ConfigError, match=told):
        runs_of(SweepConfig(**{**SHORT, **changed}))


def test_a_cell_that_a_callback_ended_is_finished(tmp_path):
    judge = {"sb3_piano.callbacks.F1Callback": {"eval_freq": 10, "stop_threshold": 0.0}}
    settings = {**SHORT["settings"], "callback": [judge]}
    found = []
    config = SweepConfig(**{**SHORT, "settings": settings})
    for _ in range(2):
        note = {"on_result": lambda run, *_: found.append(run)}
        result = sweep(config, tmp_path / "sweep", executor=Here(), **note)
        assert [run.result["num_timesteps"] for run in result] == [10]
    assert len(found) == 1  # the second call has nothing to do
    (state,) = status(config.jobs(tmp_path / "sweep"))
    assert state.result == found[0].result
    (state.job.folder / "result.json").unlink()  # as of a process that was killed as it evaluated
    (again,) = sweep(config, tmp_path / "sweep", executor=Here())
    assert again.result["metrics"] == state.result["metrics"]
    assert again.result["num_timesteps"] == 10


@pytest.mark.slow
def test_a_sweep_goes_on_where_its_runs_stopped_and_has_results(tmp_path):
    """One folder sees all: a run that had stopped, another one, results, a changed grid."""
    place = tmp_path / "sweep"
    (job,) = SweepConfig(**SHORT).jobs(place)
    # The run had stopped after its second checkpoint, and an older version had begun the sweep.
    shorter = dataclasses.replace(job.config, n_timesteps=120)
    TrainingJob(name="shorter", folder=job.folder, config=shorter).do()
    for name in ("job.yml", "result.json"):
        (job.folder / name).unlink()
    shutil.copytree(job.folder, tmp_path / "alone")
    both = SweepConfig(**{**SHORT, "variants": {"": {}, "odd": {"train_freq": [1, "episode"]}}})
    with pytest.raises(RunError, match="not empty and no sweep"):
        sweep(both, place, executor=Here())
    (place / "sweep.yml").write_text(yaml.safe_dump({job.name: job.config.to_mapping()}))
    told = []
    result = sweep(both, place, executor=Here(), on_result=lambda run, done, _: told.append(done))
    first = result[0]
    assert isinstance(first.job, Job)
    assert (first.result["started_at"], first.result["num_timesteps"]) == (120, 220)
    judged = Path(first.job.folder, "evaluation", "metrics.json").read_bytes()
    assert json.loads(judged)["num_timesteps"] == 220  # of the last model, not of the 120 steps
    assert told == [1, 2]
    assert [run.state for run in result] == ["finished", "finished"]

    resume(tmp_path / "alone", 220, progress_bar=False, checkpoint_every=60)
    alone = parameters(RunFolder(tmp_path / "alone"))
    assert torch.equal(parameters(RunFolder(first.job.folder)), alone)

    with (place / "results.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["cell"], row["seed"], row["state"]) for row in rows] == [
        (run.job.name.partition("/")[0], "0", "finished") for run in result
    ]
    assert float(rows[0]["f1"]) == first.result["metrics"]["f1"]
    again = sweep(both, place, executor=Here(), on_result=lambda *_: pytest.fail("a run"))
    assert [run.result for run in again] == [run.result for run in result]

    changed = SweepConfig(**{**SHORT, "settings": {**SHORT["settings"], "gamma": 0.5}})
    with pytest.raises(RunError, match=r"The job '.*' in '.*' has .*gamma 0.\d+, not 0.5"):
        sweep(changed, place, executor=Here())


@pytest.mark.parametrize("option", ["--out", "--storage"])
def test_a_folder_is_no_url_and_a_wrong_file_is_named(tmp_path, capsys, option):
    told = "The folder is 's3://b/s': expected a path of a file system that all machines see"
    with pytest.raises(ConfigError, match=told):
        sweep(SweepConfig(**SHORT), "s3://b/s")
    file = tmp_path / "grid.yml"
    file.write_text(yaml.safe_dump({"envs": ["Pendulum-v1"]}))
    assert main(["sweep", str(file), option, "s3://b/s"]) == 2
    assert told in capsys.readouterr().err
    file.write_text(yaml.safe_dump({"envs": ["x"], "seeds": ["one"]}))
    with pytest.raises(ConfigError, match=r"grid\.yml': seeds"):
        load_sweep(file)


@pytest.mark.slow
def test_a_cell_that_fails_does_not_stop_the_others(tmp_path, capsys):
    bad = {"env_kwargs": {"score": str(tmp_path / "gone.mid")}}
    lists = {name: list(SHORT[name]) for name in ("algos", "envs")} | {"seeds": [0, 1]}
    file = tmp_path / "grid.yml"
    file.write_text(yaml.safe_dump({**SHORT, **lists, "variants": {"bad": bad, "good": {}}}))
    more = ["--out", str(tmp_path / "sweep"), "--workers", "1", "--no-progress"]
    assert main(["sweep", str(file), *more]) == 2
    printed = capsys.readouterr()
    assert "gone.mid" in printed.err
    ended = status(load_sweep(file).jobs(tmp_path / "sweep"))
    assert [run.state for run in ended] == ["not begun", "not begun", "finished", "finished"]
    mean = statistics.mean([run.result["metrics"]["f1"] for run in ended[2:]])
    (row,) = [line for line in printed.out.splitlines() if "all 2" in line]
    assert f" {mean:.3f} " in row
    assert "An interval from so few values (2) is too narrow" in printed.out


@pytest.mark.slow
def test_an_evaluation_that_is_interrupted_leaves_its_cell_unfinished(tmp_path, monkeypatch):
    def interrupted(*arguments):
        return dataclasses.replace(evaluate(*arguments), interrupted=True)

    settings = {**SHORT["settings"], "n_timesteps": 1}
    (job,) = SweepConfig(**{**SHORT, "settings": settings}).jobs(tmp_path / "sweep")
    with monkeypatch.context() as patch:
        patch.setattr("sb3_piano.pipelines.training.evaluate", interrupted)
        with pytest.raises(KeyboardInterrupt):
            job.do()
    assert [run.state for run in status([job])] == ["1 of 1 steps"]
    assert set(job.do()["metrics"]) >= {"f1", "return"}


@pytest.mark.slow
def test_cells_on_a_cluster_have_the_weights_of_local_ones(ray_cluster, tmp_path):
    config = SweepConfig(**{**SHORT, "seeds": (0, 1)})
    there = sweep(config, tmp_path / "cluster", ray=ray_cluster.address)
    here = sweep(config, tmp_path / "local", executor=Here())
    for one, other in zip(there, here, strict=True):
        assert one.result == other.result
        assert torch.equal(*(parameters(RunFolder(job.folder)) for job in (one.job, other.job)))
