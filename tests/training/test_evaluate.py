"""Evaluation measures what the saved model plays, and writes it down."""

from __future__ import annotations

import dataclasses
import json

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

from sb3_piano.envs import RETURN_KEYS
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.music import read_midi
from sb3_piano.training import evaluate, train


class DoubleReward(gym.RewardWrapper):
    """Double the reward; named in a config by its import path."""

    def reward(self, reward):
        return 2.0 * float(reward)


@pytest.fixture
def piano_run(small_config, tmp_path, midi_file):
    """A run on the MIDI file whose model does the same whatever it sees."""
    config = small_config(
        env_id="RoboPianist-v0", env_kwargs={"score": str(midi_file)}, n_timesteps=10
    )
    folder = train(config, tmp_path / "run", progress_bar=False).folder

    def with_action(action):
        model = TD3.load(folder.model_file)
        layer = model.actor.mu[-2]
        with torch.no_grad():
            layer.weight.zero_()
            layer.bias.copy_(torch.as_tensor(np.arctanh(np.clip(action, -0.9999999, 0.9999999))))
        model.save(folder.model_file)
        return folder

    return with_action


@pytest.fixture
def pendulum_run(small_config, tmp_path):
    """Train on Pendulum, and return the run's folder."""

    def start(**changes):
        changes = {"n_timesteps": 30, **changes}
        return train(small_config(**changes), tmp_path / "run", progress_bar=False).folder

    return start


def loud_action():
    """Press both hands' fingers down."""
    return np.where(np.arange(39) % 2 == 0, 0.9, -0.3).astype(np.float32)


def test_what_was_played_is_written_as_midi_and_measured(piano_run, midi_file):
    env = gym.make("RoboPianist-v0", score=str(midi_file))
    env.reset(seed=0)
    total, over = 0.0, False
    action = np.clip(loud_action(), -0.9999999, 0.9999999)
    while not over:
        _, reward, _, over, info = env.step(action)
        total += reward
    played = env.unwrapped.performance.to_score()
    assert played is not None

    evaluation = evaluate(piano_run(loud_action()).path)
    assert evaluation.mean["length"] == len(env.unwrapped.roll)
    assert evaluation.mean["return"] == pytest.approx(total, rel=1e-3)
    for name in (*EPISODE_METRICS, *RETURN_KEYS):
        assert evaluation.mean[name] == pytest.approx(info[name], rel=1e-3, abs=1e-6), name
    notes = read_midi(evaluation.performances[0]).notes
    assert [note.pitch for note in notes] == [note.pitch for note in played.notes]
    assert [note.onset for note in notes] == pytest.approx([n.onset for n in played.notes])
    # beside it stand the same hands at rest: no wrong key, and next to no due one
    assert evaluation.mean["precision"] < evaluation.baseline["precision"] == 1.0
    assert evaluation.baseline["recall"] < 0.1


def test_hands_that_rest_equal_the_baseline_and_leave_no_midi_file(piano_run, midi_file):
    rest = gym.make("RoboPianist-v0", score=str(midi_file)).unwrapped.rest_action
    folder = piano_run(loud_action())
    assert evaluate(folder.path).performances[0].is_file()
    evaluation = evaluate(piano_run(rest).path)
    assert evaluation.performances == (None,)
    assert {path.name for path in folder.evaluation_dir.iterdir()} == {"metrics.json"}
    assert evaluation.mean == pytest.approx(evaluation.baseline, rel=1e-3, abs=1e-3)
    assert evaluation.baseline["precision"] == 1.0
    assert evaluation.baseline["recall"] < 0.1


def test_the_file_of_metrics_has_what_was_returned(piano_run):
    evaluation = evaluate(piano_run(loud_action()).path, episodes=2, seed=3)
    content = json.loads(evaluation.metrics_file.read_text())
    assert content["num_timesteps"] == 10
    assert content["seed"] == 3
    assert content["mean"] == evaluation.mean
    assert content["std"]["f1"] == 0.0  # nothing is random here
    assert content["baseline"] == evaluation.baseline
    assert content["episodes"] == list(evaluation.episodes)
    assert content["performances"] == ["performance_1.mid", "performance_2.mid"]


def test_a_run_can_be_judged_on_other_physics_than_its_own(piano_run):
    folder = piano_run(loud_action())
    returns = {}
    for physics in (None, "reference", "fast"):
        evaluation = evaluate(folder.path, physics=physics)
        returns[physics] = evaluation.mean["return_energy"]
        written = json.loads(evaluation.metrics_file.read_text())
        assert written["env_kwargs"].get("physics") == physics
    assert returns[None] == returns["reference"] != returns["fast"]
    with pytest.raises(ConfigError, match="Unknown physics profile 'quick'"):
        evaluate(folder.path, physics="quick")


@pytest.mark.parametrize("algorithm", [TD3, SAC])
def test_returns_equal_those_of_sb3s_own_evaluation_without_exploring(pendulum_run, algorithm):
    wrapper = "gymnasium.wrappers.FlattenObservation"
    folder = pendulum_run(algo=algorithm.__name__.lower(), normalize=True, env_wrapper=wrapper)
    venv = make_vec_env("Pendulum-v1", env_kwargs={"max_episode_steps": 20})
    venv = VecNormalize.load(str(folder.path / "vecnormalize.pkl"), venv)
    venv.training = False
    model = algorithm.load(folder.model_file)
    venv.seed(4)
    returns, lengths = evaluate_policy(model, venv, 3, return_episode_rewards=True)
    evaluation = evaluate(folder.path, episodes=3, seed=4)
    ours = [episode["return"] for episode in evaluation.episodes]
    assert ours == pytest.approx(returns, rel=1e-5)
    assert [episode["length"] for episode in evaluation.episodes] == lengths
    assert evaluation.mean["return"] == pytest.approx(np.mean(returns))
    assert evaluation.std["return"] == pytest.approx(np.std(returns))


def test_wrappers_act_but_do_not_change_what_is_measured(pendulum_run):
    folder = pendulum_run()
    plain = evaluate(folder.path, seed=1).mean
    config = folder.read_config()
    folder.write_config(dataclasses.replace(config, env_wrapper=f"{__name__}.DoubleReward"))
    assert evaluate(folder.path, seed=1).mean["return"] == plain["return"]


def test_other_environments_have_return_and_length_only(pendulum_run):
    evaluation = evaluate(pendulum_run().path)
    assert set(evaluation.mean) == {"return", "length"}
    assert evaluation.baseline is None
    assert evaluation.performances == (None,)


def test_the_seed_decides_how_episodes_start(pendulum_run):
    folder = pendulum_run()
    first, again, other = (evaluate(folder.path, seed=seed).mean["return"] for seed in (1, 1, 2))
    assert first == again
    assert first != other


def test_a_run_without_its_copy_of_the_model_plays_its_checkpoint(pendulum_run):
    folder = pendulum_run(normalize=True)
    expected = evaluate(folder.path).mean
    folder.model_file.unlink()
    (folder.path / "vecnormalize.pkl").unlink()
    assert evaluate(folder.path).mean == expected


def test_a_model_without_its_statistics_is_not_played_with_others(pendulum_run):
    folder = pendulum_run(normalize=True)
    (folder.path / "vecnormalize.pkl").unlink()
    (folder.checkpoint_dir / "checkpoint.json").unlink()
    with pytest.raises(RunError, match=r"expected model\.zip and vecnormalize\.pkl, written with"):
        evaluate(folder.path)


def test_a_run_without_any_model_is_refused(pendulum_run):
    folder = pendulum_run()
    folder.model_file.unlink()
    (folder.checkpoint_dir / "checkpoint.json").unlink()
    with pytest.raises(RunError, match=r"has no model: expected model\.zip, .*train --resume"):
        evaluate(folder.path)


def test_a_damaged_model_is_named(pendulum_run):
    folder = pendulum_run()
    folder.model_file.write_bytes(b"PK")
    with pytest.raises(RunError, match=r"Model '.*model\.zip' cannot be loaded"):
        evaluate(folder.path)


@pytest.mark.parametrize("changes", [{"episodes": 0}, {"seed": -1}])
def test_numbers_out_of_range_are_refused(tmp_path, changes):
    with pytest.raises(ConfigError, match="is (0|-1): expected (1|0) or more"):
        evaluate(tmp_path, **changes)


def test_a_place_that_cannot_be_written_is_named(pendulum_run):
    folder = pendulum_run()
    folder.evaluation_dir.write_text("in the way")
    with pytest.raises(RunError, match=r"evaluation' cannot be written: File exists"):
        evaluate(folder.path)
