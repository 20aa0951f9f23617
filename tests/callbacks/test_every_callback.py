"""What holds for each callback: settings that make no sense are refused by name and value."""

import pytest
from scripted import on_pieces, tiny
from short_scores import score_of
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.callbacks import (
    ActionSearchCallback,
    AveragedWeightsCallback,
    DifficultyCallback,
    F1Callback,
    LevelReplayCallback,
    MetricEvalCallback,
    PerformanceVideoCallback,
    QValueCallback,
)
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError

REFUSED = [
    (ActionSearchCallback, {"candidates": 0}, "candidates is 0: expected a whole number, 1 or"),
    (ActionSearchCallback, {"score": "critic"}, "score is 'critic'.*mean 'critics'"),
    (ActionSearchCallback, {"choice": "best"}, "choice is 'best': expected one of"),
    (ActionSearchCallback, {"optimism": -1}, "optimism is -1: expected a finite number, 0 or more"),
    (ActionSearchCallback, {"temperature": 0}, "temperature is 0: expected a finite number above"),
    (ActionSearchCallback, {"spread": -0.1}, "spread is -0.1: expected a finite number"),
    (AveragedWeightsCallback, {"decay": 1}, "decay is 1: expected"),
    (AveragedWeightsCallback, {"decay": -0.1}, "decay is -0.1: expected"),
    (DifficultyCallback, {"bands": 1}, "bands is 1: expected a whole number, 2 or more"),
    (DifficultyCallback, {"fraction": 0}, "fraction is 0: expected a finite number above 0, 1 or"),
    (DifficultyCallback, {"cumulative": 1}, "cumulative is 1: expected true or false"),
    (F1Callback, {"n_eval_episodes": 0}, "n_eval_episodes is 0: expected a whole number, 1 or"),
    (F1Callback, {"stop_patience": 0}, "stop_patience is 0: expected a whole number, 1 or more"),
    (LevelReplayCallback, {"beta": 0}, "beta is 0: expected a finite number above 0"),
    (LevelReplayCallback, {"rho": 1.5}, "rho is 1.5: expected a finite number from 0 to 1"),
    (LevelReplayCallback, {"gae_lambda": 1.1}, "gae_lambda is 1.1: expected a finite number from"),
    (MetricEvalCallback, {}, "MetricEvalCallback has no metric"),
    (PerformanceVideoCallback, {"video_freq": 9, "max_seconds": 0}, "max_seconds is 0.*above 0 s"),
    (PerformanceVideoCallback, {"video_freq": 9, "width": 641}, "width is 641: .*pixels, even as"),
    (QValueCallback, {"every": 0}, "every is 0: expected a whole number, 1 or more"),
]


@pytest.mark.parametrize(("callback", "settings", "message"), REFUSED)
def test_a_wrong_setting_is_refused_by_name_and_value(callback, settings, message):
    with pytest.raises(ConfigError, match=message):
        callback(**settings)


@pytest.mark.parametrize("callback", [DifficultyCallback, LevelReplayCallback])
def test_a_choice_is_needed_to_choose_pieces(callback):
    piece = score_of((0.0, 0.2, 60, 0))
    without = DummyVecEnv([lambda: PianoEnv(piece, physics="fast")])
    message = f"{callback.__name__} finds no environment that chooses among several pieces: exp"
    for venv in (on_pieces([piece]), without):
        with pytest.raises(ConfigError, match=message):
            tiny(venv).learn(8, callback=callback())


@pytest.mark.parametrize(
    ("callback", "algorithm", "message"),
    [
        (QValueCallback, PPO, "PPO has no Q-values to log: expected SAC, TD3"),
        (LevelReplayCallback, DQN, "DQN has no values .* expected PPO, SAC, TD3"),
    ],
)
def test_an_algorithm_without_values_is_refused(callback, algorithm, message):
    model = algorithm("MlpPolicy", "CartPole-v1", device="cpu")
    with pytest.raises(ConfigError, match=message):
        model.learn(32, callback=callback())
