"""The progress bar tells about episodes and never stays open."""

import gymnasium as gym
from scripted import tiny

from sb3_piano.callbacks import PianoProgressBar
from sb3_piano.callbacks.progress import episode_summary


def test_the_bar_counts_steps_and_tells_the_last_return():
    bar = PianoProgressBar()
    bar.close()  # before training or a second time it does nothing
    model = tiny(gym.make("Pendulum-v1", max_episode_steps=10))
    model.learn(25, callback=bar)
    last = model.ep_info_buffer[-1]["r"]
    assert bar.pbar.n == 25
    assert bar.pbar.desc == f"return {last:.1f}: "
    bar.close()


def test_the_f1_is_told_where_there_is_one():
    info = {"episode": {"r": 12.34, "l": 5, "t": 1.0}}
    assert episode_summary(info) == "return 12.3"
    assert episode_summary({**info, "f1": 0.456}) == "return 12.3, F1 0.46"
