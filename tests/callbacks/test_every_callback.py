"""What holds for each callback, as that wrong settings are refused; and the progress bar."""

import gymnasium as gym
import pytest
from scripted import on_pieces, tiny
from short_scores import score_of
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv
from yaml_rows import Tables

from sb3_piano import callbacks
from sb3_piano.callbacks import (
    DifficultyCallback,
    LevelReplayCallback,
    PianoProgressBar,
    QValueCallback,
)
from sb3_piano.callbacks.progress import episode_summary
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


def test_an_algorithm_without_values_is_refused():
    for callback, algorithm, message in (
        (QValueCallback, PPO, "PPO has no Q-values to log: expected SAC, TD3"),
        (LevelReplayCallback, DQN, "DQN has no values .* expected PPO, SAC, TD3"),
    ):
        model = algorithm("MlpPolicy", "CartPole-v1", device="cpu")
        with pytest.raises(ConfigError, match=message):
            model.learn(32, callback=callback())


def test_the_bar_counts_steps_and_tells_the_last_return_and_the_f1_where_there_is_one():
    bar = PianoProgressBar()
    bar.close()  # before training or a second time it does nothing
    model = tiny(gym.make("Pendulum-v1", max_episode_steps=10))
    model.learn(25, callback=bar)
    last = model.ep_info_buffer[-1]["r"]
    assert (bar.pbar.n, bar.pbar.desc) == (25, f"return {last:.1f}: ")
    bar.close()
    info = {"episode": {"r": 12.34, "l": 5, "t": 1.0}, "f1": 0.456}
    assert episode_summary(info) == "return 12.3, F1 0.46"
