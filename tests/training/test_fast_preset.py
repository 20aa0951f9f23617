"""This package's own settings for learning a piece from nothing."""

import contextlib

import pytest
from stable_baselines3.common.vec_env import VecNormalize

from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import NAMED, PRESETS
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.training import evaluate, load_config, train
from sb3_piano.training.playing.player import write_player
from sb3_piano.training.runs.builders import build_vec_env
from sb3_piano.vec_env import HandsAsAgents


def test_the_name_stands_for_the_file():
    assert list(NAMED["fast"]) == ["sac"]
    config = load_config("sac", "RoboPianist-v0", "fast", seed=0)
    assert config == load_config("sac", "RoboPianist-v0", NAMED["fast"]["sac"], seed=0)
    assert config != load_config("sac", "RoboPianist-v0", PRESETS["sac"], seed=0)
    with pytest.raises(ConfigError, match="No preset 'fast' comes with this package for 'td3'"):
        load_config("td3", "RoboPianist-v0", "fast")
    with pytest.raises(ConfigError, match=r"no preset of that name.* Did you mean 'fast'\?"):
        load_config("sac", "RoboPianist-v0", "fest")


@pytest.mark.parametrize("env_id", ["RoboPianist-debug-CMajorScaleTwoHands-v0", "RoboPianist-v0"])
def test_every_hand_is_an_agent_that_sees_and_does_as_much(env_id):
    config = load_config("sac", env_id, "fast", seed=0, n_envs=1)
    with contextlib.closing(build_vec_env(config)) as venv:
        assert isinstance(venv, VecNormalize)
        assert isinstance(venv.venv, HandsAsAgents)
        assert venv.num_envs == 2
        entropy = config.algorithm_kwargs["target_entropy"]
        assert -2 * venv.action_space.shape[0] < entropy < -venv.action_space.shape[0]


@pytest.mark.slow
def test_it_trains_on_any_file_and_the_run_can_be_judged_and_shared(tmp_path):
    notes = [Note(onset=0.1 * n, offset=0.1 * n + 0.1, pitch=60 + 2 * n) for n in range(3)]
    write_midi(Score(notes=notes, title="three notes"), tmp_path / "three.mid")
    config = load_config(
        "sac",
        "RoboPianist-v0",
        "fast",
        seed=0,
        n_envs=1,
        n_timesteps=120,
        learning_starts=60,
        env_kwargs={"score": str(tmp_path / "three.mid")},
    )
    run = train(config, tmp_path / "run", progress_bar=False).folder
    found = evaluate(run.path, physics="reference")
    assert 0 <= found.mean["f1"] <= 1
    assert found.baseline is not None
    assert evaluate(write_player(run.path, tmp_path / "shared").path).mean == found.mean
