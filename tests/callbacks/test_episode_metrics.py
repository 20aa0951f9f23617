"""Music metrics and reward terms arrive in SB3's log, at the right line, with the right value."""

import math

import pytest
from scripted import ScriptedEnv, log_lines, tiny, tiny_ppo, vector_of

from sb3_piano.callbacks import EpisodeMetricsCallback, RewardTermsCallback

BOTH = (EpisodeMetricsCallback, RewardTermsCallback)


def scripted(**extra):
    """Return the environment in which the F1 of the n-th episode is n / 10, from 0.1 on."""
    return ScriptedEnv([{"f1": n / 10, "return_energy": -n, **extra} for n in range(1, 10)])


def logged(folder, model, steps, log_interval=1):
    """Train and return the log's lines, by step."""
    lines = log_lines(folder, model, steps, [cls() for cls in BOTH], log_interval=log_interval)
    return {int(line["time/total_timesteps"]): line for line in lines}


def off_policy(n_envs=1, **extra):
    return tiny(vector_of(lambda: scripted(**extra), n_envs=n_envs))


@pytest.mark.parametrize(
    ("make_model", "steps", "log_interval", "expected"),
    [
        (off_policy, 20, 1, {5: 0.1, 10: 0.2, 15: 0.3, 20: 0.4}),
        (off_policy, 40, 4, {20: 0.25, 40: 0.65}),
        # 3 episodes end at a time; SB3 writes a line after each of them, the first with all values
        (lambda: off_policy(n_envs=3), 30, 3, {15: 0.1, 30: 0.2}),
        (lambda: tiny_ppo(scripted(), 10), 20, 1, {10: 0.15, 20: 0.35}),
    ],
)
def test_a_line_has_the_mean_of_the_episodes_since_the_last_line(
    tmp_path, make_model, steps, log_interval, expected
):
    lines = logged(tmp_path, make_model(), steps, log_interval=log_interval)
    assert {step: line["music/f1"] for step, line in lines.items()} == pytest.approx(expected)
    energy = {step: line["reward/energy"] / -10 for step, line in lines.items()}
    assert energy == pytest.approx(expected)


def test_each_callback_logs_only_its_own(tmp_path):
    """Of the episode's metrics, the fingers have a group of their own."""
    for callback, expected in (
        (EpisodeMetricsCallback(), {"music/f1": 0.1, "fingers/r1": 0.25}),
        (
            EpisodeMetricsCallback(["f1", "absent", "return_energy"]),
            {"music/f1": 0.1, "reward/energy": -1},
        ),
        (RewardTermsCallback(), {"reward/energy": -1}),
    ):
        model = off_policy(finger_share_r1=0.25)
        [line] = log_lines(tmp_path, model, 5, callback, log_interval=1)
        found = {n: value for n, value in line.items() if not n.startswith(("rollout/", "time/"))}
        assert found == expected


def test_what_is_no_finite_number_is_not_logged_and_does_not_count_in_the_mean(tmp_path):
    for value in (math.nan, math.inf, None, "much", {"c": 1}):
        [line] = logged(tmp_path, off_policy(return_notes=value, recall=value), 5).values()
        assert not {"reward/notes", "music/recall"} & set(line)
    infos = [{"recall": 0.25}, {"recall": math.nan}, {"recall": 0.75}, {}]
    lines = logged(tmp_path, tiny(ScriptedEnv(infos)), 20, log_interval=4)
    assert lines[20]["music/recall"] == 0.5
