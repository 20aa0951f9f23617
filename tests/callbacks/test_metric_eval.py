"""Evaluation by a music metric: what it logs, which model it keeps and when it ends a training."""

import json
import math
import re

import gymnasium
import numpy as np
import pytest
from acting import ActAt, Noted
from gymnasium.wrappers import TimeLimit
from scripted import ScriptedEnv, log_lines, series, tiny, vector_of, with_f1
from stable_baselines3 import TD3
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnvWrapper
from yaml_rows import Tables

from sb3_piano.callbacks import (
    EpisodeMetricsCallback,
    F1Callback,
    MetricEvalCallback,
    OnsetF1Callback,
)
from sb3_piano.exceptions import ConfigError, RunError

tables = Tables(__file__)


def noted():
    """Return a callback that notes the step and what the parent says."""
    return Noted(lambda own: (own.num_timesteps, own.parent.best_mean_reward))


@pytest.fixture
def model():
    return tiny(with_f1(0.0))


def evaluating(*values, **kwargs):
    """Return a callback that finds these F1, one in each evaluation, every 5 calls."""
    return F1Callback(Monitor(with_f1(*values)), eval_freq=5, **kwargs)


# What is logged.


def test_each_evaluation_logs_the_metrics_beside_what_sb3_logs_at_its_step(model, tmp_path):
    infos = [
        {"f1": 0.1, "onset_f1": 0.5, "noop_f1": 0.3, "finger_share_r1": 0.25, "other": 7.0},
        {"f1": 0.3, "onset_f1": 0.7, "noop_f1": 0.3, "finger_share_r1": 0.75, "other": 7.0},
    ]
    callback = F1Callback(Monitor(ScriptedEnv(infos)), n_eval_episodes=2, eval_freq=7)
    lines = [
        line for line in log_lines(tmp_path, model, 14, callback) if "eval/mean_reward" in line
    ]
    for name, mean in {"f1": 0.2, "onset_f1": 0.6, "noop_f1": 0.3, "finger_share_r1": 0.5}.items():
        assert series(lines, f"eval/{name}") == pytest.approx({7: mean, 14: mean})
    assert series(lines, "eval/mean_ep_length") == {7: 5.0, 14: 5.0}
    assert not [name for line in lines for name in line if "other" in name]


@pytest.mark.parametrize("metric", ["f1", "precision"])
def test_the_console_shows_few_metrics_and_the_files_all(metric, tmp_path, capsys):
    info = {"f1": 0.1, "onset_f1": 0.5, "noop_f1": 0.3, "precision": 0.4, "finger_share_r1": 0.25}
    model = tiny(ScriptedEnv([info]))
    model.set_logger(configure(str(tmp_path), ["stdout", "csv"]))
    kind = type("Own", (MetricEvalCallback,), {"metric": metric})
    found = kind(Monitor(ScriptedEnv([info])), eval_freq=5)
    model.learn(10, callback=[found, EpisodeMetricsCallback()], log_interval=1)
    printed = set(re.findall(r"\|\s+([a-z_0-9]+)\s+\|", capsys.readouterr().out))
    assert {"f1", "onset_f1", "noop_f1", metric} == printed & info.keys()
    written = (tmp_path / "progress.csv").read_text()
    assert all(f"eval/{name}" in written for name in info)
    assert "music/precision" in written
    assert "fingers/r1" in written


@pytest.mark.parametrize("n_envs", [1, 3])
def test_the_frequency_counts_calls_and_the_log_environment_steps(n_envs, tmp_path):
    model = tiny(vector_of(lambda: with_f1(0.0), n_envs=n_envs))
    lines = log_lines(tmp_path, model, 12 * n_envs, evaluating(0.1, 0.2))
    assert series(lines, "eval/f1") == pytest.approx({5 * n_envs: 0.1, 10 * n_envs: 0.2})


class TwoAgents(VecEnvWrapper):
    """Two agents play in each environment."""

    def __init__(self, *envs):
        super().__init__(DummyVecEnv([lambda env=env: Monitor(env) for env in envs]))
        self.num_envs = 2 * len(envs)

    def reset(self):
        return self.venv.reset().repeat(2, axis=0)

    def step_async(self, actions):
        self.venv.step_async(actions[::2])

    def step_wait(self):
        observations, rewards, dones, infos = self.venv.step_wait()
        infos = [dict(info) for info in infos for _ in range(2)]
        return observations.repeat(2, axis=0), rewards.repeat(2), dones.repeat(2), infos


@pytest.mark.filterwarnings("ignore:Training and eval env are not of the same type")
def test_each_whole_episode_counts_once(model, tmp_path):
    for env in (
        with_f1(0.1, 0.3),  # without a Monitor
        DummyVecEnv([lambda: Monitor(with_f1(0.1)), lambda: Monitor(with_f1(0.3))]),
        TwoAgents(with_f1(0.1, 0.3)),
        TwoAgents(with_f1(0.1), with_f1(0.3)),
    ):
        callback = F1Callback(env, eval_freq=5, n_eval_episodes=2, warn=False)
        assert series(log_lines(tmp_path, model, 5, callback), "eval/f1") == pytest.approx({5: 0.2})
        assert sorted(found["f1"] for found in callback.evaluations_metrics[0]) == [0.1, 0.3]
        log_lines(tmp_path, model, 5, callback)  # another training counts alike
        assert len(callback.evaluations_metrics[1]) == 2


def test_the_evaluations_file_has_the_metrics_and_goes_on_with_a_training(model, tmp_path, caplog):
    def callback(*values):
        infos = [{"f1": value} if value < 0.5 else {"f1": value, "recall": 0.5} for value in values]
        env = Monitor(ScriptedEnv(infos))
        return F1Callback(env, n_eval_episodes=2, eval_freq=5, log_path=str(tmp_path))

    def written():
        with np.load(tmp_path / "evaluations.npz") as found:
            return {name: found[name].tolist() for name in found.files}

    model.learn(10, callback(0.1, 0.6, 0.3, 0.4))
    assert set(written()) == {"timesteps", "results", "ep_lengths", "f1", "recall"}
    assert written()["timesteps"] == [5, 10]
    assert written()["f1"] == [[0.1, 0.6], [0.3, 0.4]]
    assert np.isnan(written()["recall"]).tolist() == [[True, False], [True, True]]
    model.num_timesteps = 7  # the last checkpoint was before the second evaluation
    model.learn(5, callback(0.6, 0.7), reset_num_timesteps=False)
    assert written()["timesteps"] == [5, 12]
    assert written()["f1"] == [[0.1, 0.6], [0.6, 0.7]]
    assert written()["recall"][1] == [0.5, 0.5]
    (tmp_path / "evaluations.npz").write_bytes(b"damaged")
    model.learn(5, callback(0.8), reset_num_timesteps=False)
    assert written()["timesteps"] == [17]
    assert "evaluations.npz' cannot be read, and begins anew" in caplog.text


def test_lines_on_the_terminal_come_only_when_asked_for(model, capsys):
    model.learn(5, evaluating(0.25))
    assert capsys.readouterr().out == ""
    model.learn(10, evaluating(0.25, 0.5, stop_threshold=0.4, verbose=1))
    env = Monitor(ScriptedEnv([{"f1": 0.25, "noop_f1": 0.125}]))
    model.learn(5, F1Callback(env, eval_freq=5, verbose=1))
    out = capsys.readouterr().out
    assert "f1 0.2500 after 5 steps (best 0.2500)\n" in out
    assert "f1 0.5000 after 10 steps (best 0.5000)\n" in out
    assert "f1 was 0.4 or more in 1 evaluations in a row: the training ends." in out
    assert "(best 0.2500, F1 of playing nothing 0.1250)\n" in out


# Which model is kept.


def best_of(folder):
    return json.loads((folder / "best_model.json").read_text())


class Loudness(MetricEvalCallback):
    metric = "loudness"


@pytest.mark.parametrize(
    ("cls", "value", "step"),
    [(F1Callback, 0.9, 5), (OnsetF1Callback, 0.2, 10), (Loudness, 3.0, 10)],
)
def test_each_callback_judges_by_its_own_metric(model, tmp_path, cls, value, step):
    infos = [
        {"f1": 0.9, "onset_f1": 0.1, "loudness": 1.0, "recall": "high"},
        {"f1": 0.1, "onset_f1": 0.2, "loudness": 3.0, "recall": math.nan},
    ]
    callback = cls(Monitor(ScriptedEnv(infos)), eval_freq=5, best_model_save_path=str(tmp_path))
    lines = log_lines(tmp_path, model, 10, callback)
    assert best_of(tmp_path) == {"metric": cls.metric, "value": value, "num_timesteps": step}
    expected = {5: infos[0][cls.metric], 10: infos[1][cls.metric]}
    assert series(lines, f"eval/{cls.metric}") == expected
    assert series(lines, "eval/recall") == {}  # none is a number


def test_what_a_model_played_before_it_learnt_may_be_the_best_and_end_the_training(model, tmp_path):
    callback = evaluating(0.6, 0.5, 0.7, evaluate_start=True, best_model_save_path=tmp_path)
    model.learn(5, callback=callback)
    assert best_of(tmp_path) == {"metric": "f1", "value": 0.6, "num_timesteps": 0}
    assert TD3.load(tmp_path / "best_model.zip").num_timesteps == 0
    model.learn(4, callback=callback, reset_num_timesteps=False)  # one that goes on: not again
    assert [found["f1"] for (found,) in callback.evaluations_metrics] == [0.6, 0.5]
    for values, steps in (([0.6], 1), ([0.4] * 3, 10)):
        model.learn(10, callback=evaluating(*values, evaluate_start=True, stop_threshold=0.5))
        assert model.num_timesteps == steps


def test_the_best_model_is_that_of_the_highest_metric_also_in_a_training_that_goes_on(
    model, tmp_path
):
    path = str(tmp_path)
    model.learn(25, evaluating(0.2, 0.6, 0.4, math.nan, 0.6, best_model_save_path=path))
    assert best_of(tmp_path) == {"metric": "f1", "value": 0.6, "num_timesteps": 10}
    assert TD3.load(tmp_path / "best_model.zip").num_timesteps == 10
    assert sorted(path.name for path in tmp_path.iterdir()) == ["best_model.json", "best_model.zip"]
    for found, best in ((0.5, 0.6), (0.7, 0.7)):
        callback = evaluating(found, best_model_save_path=path)
        model.learn(5, callback, reset_num_timesteps=False)
        assert callback.best_mean_reward == best
        assert best_of(tmp_path)["value"] == best
    env = Monitor(ScriptedEnv([{"onset_f1": 0.1}]))  # a best model by another metric does not count
    callback = OnsetF1Callback(env, eval_freq=5, best_model_save_path=path)
    model.learn(5, callback, reset_num_timesteps=False)
    assert best_of(tmp_path)["value"] == 0.1
    model.learn(5, evaluating(0.05, best_model_save_path=path))  # a new training
    assert best_of(tmp_path)["value"] == 0.05


@pytest.mark.parametrize(("content", "where"), [("", "Inv"), ('{"metric": 1}', "metric: ")])
def test_a_damaged_note_beside_the_best_model_is_named(model, tmp_path, content, where):
    model.learn(5)
    (tmp_path / "best_model.json").write_text(content)
    with pytest.raises(RunError, match=rf"best_model.json' cannot be read \({where}"):
        model.learn(
            5, evaluating(0.6, best_model_save_path=str(tmp_path)), reset_num_timesteps=False
        )


# Who is told, and when the training ends.


def test_children_see_the_metric_as_the_parents_best_and_may_end_the_training(model):
    new_best, after = noted(), noted()
    callback = evaluating(
        0.2, 0.6, 0.4, callback_on_new_best=new_best, callback_after_eval=CallbackList([after])
    )
    model.learn(15, callback)
    assert new_best.seen == [(5, 0.2), (10, 0.6)]
    assert after.seen == [(5, 0.2), (10, 0.6), (15, 0.6)]
    assert callback.last_mean_reward == 0.4
    for event in ("callback_on_new_best", "callback_after_eval"):
        model.learn(15, evaluating(0.2, **{event: ActAt(5, "stop")}))
        assert model.num_timesteps == 5


@tables("values, patience, steps")
def test_a_threshold_that_is_held_ends_the_training(model, values, patience, steps):
    model.learn(25, evaluating(*values, stop_threshold=0.5, stop_patience=patience))
    assert model.num_timesteps == steps


# The evaluation environment.


@pytest.mark.parametrize("seed", [7, None])
def test_every_evaluation_has_the_same_seed_if_there_is_one(model, seed):
    env = with_f1(0.1)
    model.learn(15, F1Callback(Monitor(env), n_eval_episodes=2, eval_freq=5, seed=seed))
    # 3 x (the two episodes, and the one that the vector begins after the last)
    first = env.first_draws[:3]
    assert len(set(first)) == 3
    if seed is None:
        assert len(set(env.first_draws)) == 9
    else:
        assert env.first_draws == first * 3
        assert first[0] == np.random.default_rng(7).random()


def test_a_given_environment_is_left_open_and_its_own_is_closed(model):
    given = with_f1(0.1)
    model.learn(5, F1Callback(Monitor(given), eval_freq=5))
    assert not given.closed

    spy = Noted(lambda own: own.parent.eval_env.envs[0].unwrapped)
    callback = F1Callback(eval_freq=5, callback_after_eval=spy)
    for _ in range(2):  # a second training makes a second one
        training = with_f1(0.1)
        tiny(training).learn(5, callback)
        assert spy.seen[-1] is not training
        assert (spy.seen[-1].ended, spy.seen[-1].closed) == (1, True)
    callback.on_training_end()  # RL Zoo does so twice
    assert not training.closed


def test_an_environment_without_the_metric_is_named(model):
    env = Monitor(ScriptedEnv([{"f2": 0.1}]))
    with pytest.raises(ConfigError, match="info of 'ScriptedEnv' lacks.*mean 'f2'.*Expected a pi"):
        model.learn(5, F1Callback(env, eval_freq=5))
    env = TimeLimit(Monitor(with_f1(0.1)), 3)  # whose end the Monitor does not see
    with pytest.raises(ConfigError, match="'ScriptedEnv' was ended by a wrapper around"):
        model.learn(5, F1Callback(env, eval_freq=5))
    model = tiny("Pendulum-v1")  # of gymnasium, before a step
    with pytest.raises(ConfigError, match="cannot evaluate Pendulum-v1.*no 'f1': expected a piano"):
        model.learn(300, F1Callback(eval_freq=5))
    assert model.num_timesteps == 0
    with pytest.raises(ConfigError, match="F1Callback cannot evaluate CartPole-v1"):  # at once
        F1Callback(gymnasium.make("CartPole-v1"))
