"""What holds for each callback: settings that make no sense are refused by name and value."""

import pytest
from scripted import on_pieces, tiny
from short_scores import score_of
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv
from yaml_rows import Tables

from sb3_piano import callbacks
from sb3_piano.callbacks import DifficultyCallback, LevelReplayCallback, QValueCallback
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError

tables = Tables(__file__)


@tables("callback, settings, message")
def test_a_wrong_setting_is_refused_by_name_and_value(callback, settings, message):
    with pytest.raises(ConfigError, match=message):
        getattr(callbacks, callback)(**settings)


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
