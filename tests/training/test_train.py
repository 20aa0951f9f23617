"""Training, Ctrl-C, and going on from where it stopped."""

import dataclasses
import shutil
import signal
import threading

import numpy as np
import pytest
import torch
from acting import ActAt, act_at, parameters, scalars
from stable_baselines3 import PPO, TD3
from stable_baselines3.common.monitor import load_results
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.training import RunFolder, resume, train
from sb3_piano.training.runs import train as session_module

tables = Tables(__file__)


@pytest.mark.slow
def test_a_training_writes_model_checkpoint_monitor_and_log(run, episodes_of):
    result = run()
    folder = result.folder
    assert (result.started_at, result.num_timesteps, result.interrupted) == (0, 100, False)
    assert TD3.load(folder.model_file).num_timesteps == 100
    assert Checkpoint.read(folder.checkpoint_dir).labels == {"algo": "td3", "env_id": "Pendulum-v1"}
    assert [episode["l"] for episode in episodes_of(folder.monitor_dir)] == [20] * 5
    # after four episodes, and what is left at the end
    assert set(scalars(folder, "rollout/ep_rew_mean")) == {80, 100}


def test_a_training_leaves_no_thread_behind(run, small_config, tmp_path):
    before = threading.active_count()
    train(small_config(n_timesteps=10), tmp_path / "whole", progress_bar=False)
    assert threading.active_count() == before
    with pytest.raises(RuntimeError, match="crash"):
        run(callback=[act_at(10, "crash")])
    assert threading.active_count() == before


@pytest.mark.slow
def test_equal_seeds_give_equal_models_and_others_do_not(small_config, tmp_path):
    models = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        config = small_config(seed=seed, n_timesteps=50)
        models.append(parameters(train(config, tmp_path / name, progress_bar=False).folder))
    assert torch.equal(models[0], models[1])
    assert not torch.equal(models[0], models[2])


def test_a_seed_that_was_not_given_is_drawn_and_noted(run):
    config = run(seed=None, n_timesteps=20).folder.read_config()
    assert isinstance(config.seed, int)


@tables("changes, message")
def test_nothing_is_written_if_anything_cannot_be_built(run, tmp_path, changes, message):
    with pytest.raises(ConfigError, match=message):
        run(**changes)
    assert list(tmp_path.iterdir()) == []


def test_an_info_keyword_that_the_environment_does_not_tell_is_named(run):
    with pytest.raises(ConfigError, match="has 'f1', which the info of 'Pendulum-v1'"):
        run(monitor_kwargs={"info_keywords": ["f1"]})


@pytest.mark.slow
@pytest.mark.parametrize("action", ["SIGINT", "SIGTERM", "SIGHUP", "keyboard"])
def test_an_interruption_saves_and_says_so(run, action):
    former = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    result = run(every=1000, callback=act_at(50, action))
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == former
    assert (result.interrupted, result.num_timesteps) == (True, 50)
    saved = Checkpoint.read(result.folder.checkpoint_dir)
    assert saved.num_timesteps == 50
    # a signal waits until the step is in the buffer; an exception in mid-step does not
    assert saved.replay.total == (49 if action == "keyboard" else 50)


@pytest.mark.parametrize(
    ("n_timesteps", "step", "done", "interrupted"), [(80, 50, 50, True), (50, 55, 60, False)]
)
def test_an_on_policy_training_ends_within_its_rollout_unless_it_is_the_last(
    small_config, tmp_path, n_timesteps, step, done, interrupted
):
    options = {"batch_size": 20, "n_epochs": 1}  # and rollouts of 20 steps
    whole = small_config(algo="ppo", n_timesteps=n_timesteps, algorithm_kwargs=options)
    config = dataclasses.replace(whole, callback=act_at(step, "SIGINT"))
    result = train(config, tmp_path / "run", progress_bar=False)
    assert (result.interrupted, result.num_timesteps) == (interrupted, done)
    assert PPO.load(result.folder.model_file).num_timesteps == done
    if interrupted:
        again = resume(result.folder.path, progress_bar=False)
        assert (again.started_at, again.num_timesteps >= 80) == (done, True)
    else:  # it learns from its last rollout
        all_of_it = train(whole, tmp_path / "whole", progress_bar=False).folder
        assert torch.equal(parameters(result.folder, PPO), parameters(all_of_it, PPO))


@pytest.mark.parametrize(("step", "action"), [(50, "stop"), (100, "SIGINT")])
def test_a_callback_that_stops_or_a_signal_in_the_last_step_is_no_interruption(run, step, action):
    with stop_on_signal() as request:  # as who trains one after the other
        result = run(callback=act_at(step, action))
    assert (result.interrupted, result.num_timesteps) == (False, step)
    assert Checkpoint.read(result.folder.checkpoint_dir).num_timesteps == step
    assert request.made == (action == "SIGINT")


def test_a_progress_bar_is_shown_and_taken_away_whatever_happens(
    small_config, tmp_path, capsys, monkeypatch
):
    bars = []

    class Spy(session_module.PianoProgressBar):
        def __init__(self):
            super().__init__()
            bars.append(self)

    monkeypatch.setattr(session_module, "PianoProgressBar", Spy)
    train(small_config(n_timesteps=40), tmp_path / "a")
    assert "40/40" in capsys.readouterr().out
    with pytest.raises(RuntimeError, match="crash"):
        train(small_config(callback=act_at(10, "crash")), tmp_path / "b")
    assert [bar.pbar.disable for bar in bars] == [True, True]  # closed


def test_a_training_without_tensorboard_says_so_and_goes_on(run, monkeypatch):
    monkeypatch.setattr(session_module.importlib.util, "find_spec", lambda name: None)
    with pytest.warns(UserWarning, match="not logged: pip install tensorboard"):
        folder = run(n_timesteps=20).folder
    assert folder.model_file.is_file()
    assert not folder.tensorboard_dir.exists()


@pytest.mark.slow
def test_after_a_crash_the_last_checkpoint_can_be_resumed(run, monkeypatch, tmp_path):
    with pytest.raises(RuntimeError, match="crash"):
        run(callback=act_at(50, "crash"))
    monkeypatch.setattr(ActAt, "_on_step", lambda self: True)
    folder = RunFolder.open(tmp_path / "run")
    assert Checkpoint.read(folder.checkpoint_dir).num_timesteps == 30
    (folder.path / "best_f1").mkdir()
    left = [folder.path / "model.zip.1.partial", folder.path / "best_f1/best_model.zip.1.partial"]
    for file in left:  # by a process that was killed meanwhile
        file.touch()
    result = resume(folder.path, progress_bar=False)
    assert (result.started_at, result.num_timesteps) == (30, 100)
    assert not any(file.exists() for file in left)


@pytest.mark.slow
def test_resuming_goes_on_with_steps_rows_updates_statistics_and_logs(
    run, monkeypatch, episodes_of
):
    seen = {}

    class Spy(session_module.ResumableCheckpoint):
        def _on_training_start(self):
            buffer = self.model.replay_buffer
            seen.setdefault("rows", []).append(buffer.size())
            seen.setdefault("steps", []).append(self.model.num_timesteps)
            seen.setdefault("updates", []).append(self.model._n_updates)
            seen.setdefault("normal", []).append(self.model.get_vec_normalize_env().obs_rms.count)
            seen.setdefault("last", []).append(buffer.dones[buffer.pos - 1, 0])

    monkeypatch.setattr(session_module, "ResumableCheckpoint", Spy)
    first = run(n_timesteps=60, env_kwargs={"max_episode_steps": 23}, normalize=True)
    second = resume(first.folder.path, 100, progress_bar=False, checkpoint_every=30)
    assert seen["steps"] == seen["rows"] == [0, 60]
    assert seen["updates"] == [0, 40]
    assert seen["normal"][1] == pytest.approx(62, abs=0.01)  # 60 steps and two resets
    assert seen["last"][1] == 1.0  # the 3rd episode was cut at its 14th step
    assert (second.started_at, second.num_timesteps, second.had_finished) == (60, 100, False)
    assert TD3.load(second.folder.model_file)._n_updates == 80
    assert second.folder.read_config().n_timesteps == 100
    episodes = episodes_of(second.folder.monitor_dir)
    assert [episode["l"] for episode in episodes] == [23] * 3
    sorted_by_time = load_results(str(second.folder.monitor_dir))
    assert sorted_by_time["r"].tolist() == [episode["r"] for episode in episodes]
    assert set(scalars(second.folder, "rollout/ep_rew_mean")) >= {60, 100}
    assert len(list(second.folder.tensorboard_dir.iterdir())) == 1


@pytest.mark.slow
def test_resuming_is_deterministic_and_starts_other_episodes_than_the_first_sitting(run, tmp_path):
    first = run(n_timesteps=60)
    models = []
    for name in ("a", "b"):
        copy = shutil.copytree(first.folder.path, tmp_path / name)
        models.append(parameters(resume(copy, 100, progress_bar=False).folder))
    assert torch.equal(*models)
    folder = tmp_path / "a" / "checkpoint"
    starts = {}
    for segment in Checkpoint.read(folder).replay.segments:
        with np.load(folder / segment.file) as rows:
            observations = rows["observations"]
        starts |= {segment.first + n: row.tolist() for n, row in enumerate(observations)}
    assert starts[60] != starts[0]  # the first observations of both sittings


def test_a_finished_run_is_left_alone_but_for_a_model_that_was_not_copied(pendulum_run):
    folder = pendulum_run(normalize=True)
    before = {path: path.stat().st_mtime_ns for path in folder.path.rglob("*")}
    for steps in (None, 30, 20):
        result = resume(folder.path, steps)
        assert (result.had_finished, result.num_timesteps) == (True, 30)
    assert {path: path.stat().st_mtime_ns for path in folder.path.rglob("*")} == before
    assert folder.read_config().n_timesteps == 30
    # It was killed between its last checkpoint and the copies of it.
    copies = [folder.model_file, folder.model_file.with_name("vecnormalize.pkl")]
    expected = [file.read_bytes() for file in copies]
    for file in copies:
        file.write_bytes(b"of the checkpoint before")
    assert resume(folder.path).had_finished
    assert [file.read_bytes() for file in copies] == expected


@pytest.mark.slow
def test_a_run_that_had_saved_nothing_starts_over(run, monkeypatch, caplog, tmp_path, episodes_of):
    with pytest.raises(RuntimeError, match="crash"):
        run(every=1000, callback=act_at(50, "crash"))
    monkeypatch.setattr(ActAt, "_on_step", lambda self: True)
    result = resume(tmp_path / "run", progress_bar=False)
    assert (result.started_at, result.num_timesteps) == (0, 100)
    assert "had saved nothing yet: it starts over at step 0" in caplog.text
    assert len(episodes_of(result.folder.monitor_dir)) == 5  # none of the first attempt
    assert [path.name for path in result.folder.tensorboard_dir.iterdir()] == ["run_1"]


@tables("asked, message")
def test_another_run_than_asked_for_is_refused(pendulum_run, asked, message):
    folder = pendulum_run()
    with pytest.raises(ConfigError, match=message):
        resume(folder.path, 40, **asked)


@tables("file, old, new, message")
def test_a_checkpoint_or_a_model_of_another_run_is_refused(pendulum_run, file, old, new, message):
    folder = pendulum_run()
    files = [folder.checkpoint_dir / "checkpoint.json", folder.config_file]
    for path in files[:1] if file == "checkpoint" else files:
        path.write_text(path.read_text().replace(old, new))
    with pytest.raises(RunError, match=message):
        resume(folder.path, 40)
