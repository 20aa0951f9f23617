"""Training writes a run's folder, and can be interrupted at any time."""

from __future__ import annotations

import dataclasses
import signal
import threading

import pytest
import torch
from acting import act_at, parameters, scalars
from stable_baselines3 import PPO, TD3

from sb3_piano.callbacks import Checkpoint
from sb3_piano.exceptions import ConfigError
from sb3_piano.training import session as session_module
from sb3_piano.training import train
from sb3_piano.training.interrupts import stop_on_signal


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
    for number in range(3):
        train(small_config(n_timesteps=30), tmp_path / str(number), progress_bar=False)
    assert threading.active_count() == before
    with pytest.raises(RuntimeError, match="crash"):
        run(callback=[act_at(10, "crash")])
    assert threading.active_count() == before


def test_a_signal_at_the_last_step_reaches_who_trains_one_after_the_other(run):
    with stop_on_signal() as request:
        result = run(callback=[act_at(100, "SIGTERM")])
        assert not result.interrupted  # it was over
        assert request.made


@pytest.mark.slow
def test_equal_seeds_give_equal_models_and_others_do_not(small_config, tmp_path):
    models = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        result = train(small_config(seed=seed), tmp_path / name, progress_bar=False)
        models.append(parameters(result.folder))
    assert torch.equal(models[0], models[1])
    assert not torch.equal(models[0], models[2])


def test_a_seed_that_was_not_given_is_drawn_and_noted(run):
    config = run(seed=None, n_timesteps=20).folder.read_config()
    assert isinstance(config.seed, int)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"env_kwargs": {"gravity": 1}}, "cannot be made with env_kwargs"),
        ({"env_id": "CartPole-v1"}, "TD3 cannot be made"),
        ({"callback": "builtins.dict"}, "no subclass of BaseCallback"),
    ],
)
def test_nothing_is_written_if_anything_cannot_be_built(run, tmp_path, changes, message):
    with pytest.raises(ConfigError, match=message):
        run(**changes)
    assert list(tmp_path.iterdir()) == []


def test_no_folder_is_made_for_a_wrong_checkpoint_interval(run, tmp_path):
    with pytest.raises(ConfigError, match="checkpoint_every is 0: expected a whole number"):
        run(every=0)
    assert list(tmp_path.iterdir()) == []


def test_the_environments_are_closed_whatever_happens(run, monkeypatch):
    closed = []
    monkeypatch.setattr(
        "stable_baselines3.common.vec_env.DummyVecEnv.close", lambda self: closed.append(True)
    )
    with pytest.raises(RuntimeError, match="crash"):
        run(callback=act_at(50, "crash"))
    assert closed == [True]


def test_an_info_keyword_that_the_environment_does_not_tell_is_named(run):
    with pytest.raises(
        ConfigError, match="info_keywords has 'f1', which the info of 'Pendulum-v1'"
    ):
        run(monitor_kwargs={"info_keywords": ["f1"]})


@pytest.mark.slow
@pytest.mark.parametrize("action", ["SIGINT", "SIGTERM", "keyboard"])
def test_an_interruption_saves_and_says_so(run, action):
    former = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    result = run(every=1000, callback=act_at(50, action))
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == former
    assert (result.interrupted, result.num_timesteps) == (True, 50)
    saved = Checkpoint.read(result.folder.checkpoint_dir)
    assert saved.num_timesteps == 50
    # a signal waits until the step is in the buffer; an exception in mid-step does not
    assert saved.replay.total == (49 if action == "keyboard" else 50)


def test_an_interrupted_on_policy_training_ends_within_its_rollout(ppo_config, tmp_path):
    config = dataclasses.replace(ppo_config, callback=act_at(50, "SIGINT"))
    result = train(config, tmp_path / "run", progress_bar=False)
    assert (result.interrupted, result.num_timesteps) == (True, 50)
    assert PPO.load(result.folder.model_file).num_timesteps == 50


def test_a_callback_that_stops_the_training_is_no_interruption(run):
    result = run(callback=act_at(50, "stop"))
    assert (result.interrupted, result.num_timesteps) == (False, 50)
    assert Checkpoint.read(result.folder.checkpoint_dir).num_timesteps == 50


@pytest.mark.slow
def test_a_signal_in_the_last_step_does_not_undo_a_finished_training(run):
    result = run(callback=act_at(100, "SIGINT"))
    assert (result.interrupted, result.num_timesteps) == (False, 100)


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


def test_training_outside_the_main_thread_works(run):
    results = []
    thread = threading.Thread(target=lambda: results.append(run(n_timesteps=20)))
    thread.start()
    thread.join()
    assert results[0].num_timesteps == 20
