"""Curricula: their YAML files, their stages one after the other, and what stops them."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import pytest
import torch
import yaml
from acting import act_at, states_of
from scripted import with_f1
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from tiny_curriculum import NO_PIANO, PENDULUM, SMALL
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.jobs import status
from sb3_piano.locks import hold
from sb3_piano.pipelines import Curriculum, load_curriculum, run_curriculum
from sb3_piano.pipelines.curriculum import curriculum_jobs
from sb3_piano.training import RunFolder, resume, train

tables = Tables(__file__)


class SavesBeginning(BaseCallback):
    """Save the model as the training begins; named in curricula by its import path."""

    def use_run(self, run):
        self.folder = run.folder

    def _on_training_start(self):
        self.model.save(self.folder / "beginning.zip")

    def _on_step(self):
        return True


SAVES_BEGINNING = [f"{__name__}.SavesBeginning"]
STOPPED = {**PENDULUM, "callback": act_at(10, "SIGINT")}


gym.register("OnlyF1-v0", lambda: with_f1(0.5))


@pytest.fixture
def write_piano(write):
    """The same for stages on one hand's part of the first 1.5 s of studies."""

    def make(*stages, **common):
        env_kwargs = {"physics": "fast", "observation": "fingers", "hands_in_scene": "right"}
        excerpt = {"sb3_piano.wrappers.Excerpt": {"length": 1.5}}
        return write(*stages, env_kwargs=env_kwargs, env_wrapper=[excerpt], callback=[], **common)

    return make


@pytest.fixture
def run(tmp_path):
    """Return a function that runs the curriculum of a file in one folder."""

    def start(file, **options):
        curriculum = replace(load_curriculum(file), seed=options.pop("seed", 1))
        settings = {"progress_bar": False, "checkpoint_every": 20, **options}
        return run_curriculum(curriculum, tmp_path / "out", **settings)

    return start


def ends(result):
    """Return each stage's name, its steps, and what ended it."""
    return [
        (run.job.name, run.job.progress()[0], (run.result or {}).get("ended_by")) for run in result
    ]


def curriculum_status(folder):
    return status(curriculum_jobs(folder, load_curriculum(folder)))


def folders(result):
    return [RunFolder(run.job.folder) for run in result]


def evaluated(runs):
    """Return after how many steps each stage was evaluated."""
    return [[*run.job.evaluations()] for run in runs]


def assert_equal_models(one, other):
    ours, theirs = (states_of(SAC.load(file, device="cpu")) for file in (one, other))
    assert ours.keys() == theirs.keys()
    assert [name for name in ours if not torch.equal(ours[name], theirs[name])] == []


def content(folder):
    """Return all files of a folder with their bytes."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# What would only be known when a stage begins.


@tables("stage, message")
def test_stages_that_do_not_fit_are_refused_before_any_is_trained(
    write, run, tmp_path, stage, message
):
    file = write(PENDULUM, {k: v for k, v in {**PENDULUM, **stage}.items() if v is not None})
    with pytest.raises(ConfigError, match=f"^Stage 2: (?!Stage).*{message}"):
        run(file)
    assert not (tmp_path / "out").exists()


# Stages one after the other.


@pytest.mark.slow
def test_each_stage_starts_from_what_the_one_before_has_learnt(write_piano, run, tmp_path):
    file = write_piano(
        {"piece": "hanon-01", "env_kwargs": {"tempo": 60}, "n_timesteps": 80},
        {"piece": "hanon-01", "env_kwargs": {"tempo": 108}, "n_timesteps": 70, "gamma": 0.5},
        {"env": "RoboPianist-debug-CMajorScaleOneHand-v0", "with_buffer": True},
    )
    file.write_text(file.read_text().replace("callback: []", f"callback: {SAVES_BEGINNING}"))
    result = run(file)
    assert result[-1].result is not None
    assert ends(result) == [
        ("1_hanon-01", 80, "budget"),
        ("2_hanon-01", 70, "budget"),
        ("3_RoboPianist-debug-CMajorScaleOneHand-v0", 60, "budget"),
    ]
    first, second, third = folders(result)
    assert_equal_models(second.path / "beginning.zip", first.model_file)
    assert_equal_models(third.path / "beginning.zip", second.model_file)
    with pytest.raises(AssertionError):
        assert_equal_models(second.path / "beginning.zip", second.model_file)
    assert second.read_config().env_kwargs["tempo"] == 108
    assert second.read_config().algorithm_kwargs["gamma"] == 0.5
    rows = [Checkpoint.read(run.checkpoint_dir).replay.total for run in folders(result)]
    assert rows == [80, 70, 70 + 60]
    assert {run.read_config().seed for run in folders(result)} == {1}
    # each is a run like any other
    assert resume(second.path, 75, progress_bar=False).num_timesteps == 75


OWN = {"sb3_piano.callbacks.F1Callback": {"eval_freq": 40, "evaluate_start": True}}
BOTH = [OWN, {"sb3_piano.callbacks.OnsetF1Callback": {"eval_freq": 30}}]


@pytest.mark.slow
def test_a_condition_that_is_met_ends_its_stage(write_piano, run):
    """It goes by the callbacks that evaluate; the model is the one that was evaluated."""
    file = write_piano(
        {"piece": "hanon-01", "until": {"f1": 0, "eval_freq": 25}},
        {"piece": "hanon-02", "until": {"f1": 0, "onset_recall": 1, "eval_freq": 25}},
        {"piece": "hanon-03", "until": {"recall": 0, "eval_freq": 25, "patience": 2}},
        {"piece": "hanon-01", "callback": [OWN], "until": {"f1": 0}, "name": "good at once"},
        {"piece": "hanon-01", "callback": BOTH, "until": {"f1": 1}, "n_timesteps": 45},
        {"piece": "hanon-01", "callback": BOTH, "until": {"f1": 1, "eval_freq": 20}},
    )
    result = run(file)
    assert [end[1:] for end in ends(result)] == [
        *((25, "condition"), (60, "budget"), (50, "condition")),
        *((1, "condition"), (45, "budget"), (60, "budget")),
    ]
    steps = [[25], [25, 50], [25, 50], [0], [0, 30, 40], [0, 20, 40, 60]]
    assert evaluated(result) == steps
    metrics = result[1].job.evaluations()[25]
    assert {"f1", "onset_f1", "onset_recall"} <= metrics.keys()
    assert SAC.load(folders(result)[0].model_file).num_timesteps == 25
    assert [plugin.path for plugin in folders(result)[4].read_config().callback] == [
        "sb3_piano.callbacks.F1Callback",
        "sb3_piano.callbacks.OnsetF1Callback",
        "sb3_piano.training.StartFromRun",
    ]
    known = [run.result for run in curriculum_status(result[0].job.folder.parent)]
    assert known == [run.result for run in result]
    before = content(result[0].job.folder.parent)
    again = run(file, on_stage=lambda stage: pytest.fail(stage.name))
    assert (ends(again), content(result[0].job.folder.parent)) == (ends(result), before)


def test_a_metric_that_the_environment_does_not_tell_is_named(write, run):
    until = {"f1": 0, "recall": 0, "eval_freq": 9}
    file = write({"env": "OnlyF1-v0", **NO_PIANO, "until": until})
    with pytest.raises(ConfigError, match="Unknown metric 'recall' of until"):
        run(file)


def test_another_callback_may_end_a_stage_and_ctrl_c_in_its_last_step_begins_no_other(write, run):
    stopped, last = ({**PENDULUM, "callback": act_at(*at)} for at in ((30, "stop"), (60, "SIGINT")))
    result = run(write(stopped, last, PENDULUM))
    assert [end[1:] for end in ends(result)] == [(30, "callback"), (60, "budget"), (0, None)]
    assert result[-1].result is None
    assert not folders(result)[2].path.exists()


@pytest.mark.slow
def test_the_first_stage_may_start_from_a_run(write, tmp_path, monkeypatch):
    """Also one in the working folder, in a curriculum that was not read from a file."""
    monkeypatch.chdir(tmp_path)
    entry = {name: value for name, value in SMALL.items() if name != "algo"}
    Path("own.yml").write_text(yaml.safe_dump({"default": {**entry, "policy": "MlpPolicy"}}))
    (alone,) = load_curriculum(write({**PENDULUM, "config": "own.yml"})).stages
    source = train(alone.run_config("sac"), "source", progress_bar=False).folder
    stage = {**PENDULUM, "config": "own.yml", "callback": SAVES_BEGINNING}
    mapping = {"algo": "sac", "init_from": "source", "with_buffer": True, "stages": [stage]}
    begun = []
    for _ in range(2):
        curriculum, on_stage = Curriculum.from_mapping(mapping), begun.append
        result = run_curriculum(curriculum, "out", progress_bar=False, on_stage=on_stage)
    assert len(begun) == 1
    (folder,) = folders(result)
    assert_equal_models(folder.path / "beginning.zip", source.model_file)
    assert Checkpoint.read(folder.checkpoint_dir).replay.total == 60 + 60


def test_stages_take_several_pieces(write_piano, run):
    file = write_piano({"pieces": "hanon-0[12]", "n_envs": 2, "n_timesteps": 20})
    (stage,) = folders(run(file))
    assert stage.path.name == "1_hanon-0-12-"
    assert stage.read_config().pieces == ("hanon-01", "hanon-02")


# Going on.


@pytest.mark.slow
def test_patience_goes_on_across_an_interruption(write_piano, run):
    until = {"f1": 0, "eval_freq": 20, "patience": 3}
    file = write_piano({"piece": "hanon-01", "until": until, "n_timesteps": 200})
    file.write_text(file.read_text().replace("callback: []", f"callback: {act_at(45, 'SIGINT')}"))
    result = run(file, checkpoint_every=1000)
    assert (ends(result), evaluated(result)) == ([("1_hanon-01", 45, None)], [[20, 40]])
    result = run(file)
    assert ends(result) == [("1_hanon-01", 65, "condition")]
    assert evaluated(result) == [[20, 40, 65]]


@pytest.fixture
def crashed(write_piano, run, tmp_path):
    """A curriculum whose first stage crashes at step 35, ten steps after its last checkpoint."""
    until = {"f1": 0, "eval_freq": 10, "patience": 5}
    file = write_piano({"piece": "hanon-01", "until": until}, {"piece": "hanon-02"})
    crash = file.read_text().replace("callback: []", f"callback: {act_at(35, 'crash')}")
    file.write_text(crash)

    def again():
        with pytest.raises(RuntimeError, match="crash"):
            run(file, checkpoint_every=25)
        return evaluated(curriculum_status(tmp_path / "out"))

    assert again() == [[10, 20, 30], []]
    assert Checkpoint.read(tmp_path / "out/1_hanon-01/checkpoint").num_timesteps == 25
    return again


@pytest.mark.slow
def test_after_a_crash_evaluations_of_a_lost_model_are_forgotten_and_the_saved_one_may_be_the_last(
    crashed, tmp_path
):
    """The second as of a process that is killed after its last checkpoint, before its result."""
    assert crashed() == [[10, 20], []]
    first = tmp_path / "out" / "1_hanon-01"
    noted = json.loads((first / "evaluations.json").read_text())
    good = noted["evaluations"][0]
    steps = (5, 10, 15, 20, 25, 30)
    noted["evaluations"] = [{**good, "num_timesteps": number} for number in steps]
    (first / "evaluations.json").write_text(json.dumps(noted))
    (first / "model.zip").unlink(missing_ok=True)
    crashed()  # in the second stage
    (ended, _) = curriculum_status(tmp_path / "out")
    assert (ended.result["num_timesteps"], ended.result["ended_by"]) == (25, "condition")
    assert SAC.load(first / "model.zip").num_timesteps == 25


def test_a_stage_that_starts_over_has_no_evaluations(write_piano, run, tmp_path):
    evaluates = {"sb3_piano.callbacks.F1Callback": {"evaluate_start": True}}
    callback = [evaluates, act_at(5, "crash")]
    file = write_piano({"piece": "hanon-01", "callback": callback})
    for _ in range(2):
        with pytest.raises(RuntimeError, match="crash"):
            run(file)
        assert evaluated(curriculum_status(tmp_path / "out")) == [[0]]


# The folder.


@pytest.mark.slow
def test_what_has_begun_keeps_its_settings_and_what_has_not_may_change(write, run, tmp_path):
    result = run(write(PENDULUM, STOPPED, PENDULUM))
    assert [end[1:] for end in ends(result)] == [(60, "budget"), (10, None), (0, None)]
    before = content(tmp_path / "out")
    for stages, options, message in tables["what_has_begun"]:
        pairs = zip((PENDULUM, STOPPED), stages, strict=False)
        file = write(*({**stage, **changed} for stage, changed in pairs), **options)
        with pytest.raises(RunError, match=message):
            run(file, seed=options.get("seed"))
    with pytest.raises(ConfigError, match="^Stage 3: Its normalize is True"):
        run(write(PENDULUM, STOPPED, {**PENDULUM, "normalize": True}))
    assert content(tmp_path / "out") == before
    file = write(PENDULUM, STOPPED, {**PENDULUM, "gamma": 0.5}, {**PENDULUM, "name": "last"})
    result = run(file, seed=None)
    assert [end[1:] for end in ends(result)] == [(60, "budget")] * 4
    assert folders(result)[2].read_config().algorithm_kwargs["gamma"] == 0.5
    assert folders(result)[3].path.name == "4_last"
    assert load_curriculum(tmp_path / "out") == replace(load_curriculum(file), seed=1)


def test_one_process_at_a_time_trains_in_a_folder(write, run, tmp_path):
    with (
        hold(tmp_path / "out" / ".lock"),
        pytest.raises(RunError, match="is being trained by process .* --status"),
    ):
        run(write(PENDULUM))
