"""Episodes that a wrapper around the environment ends have the music metrics, too."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import Autoreset, TimeLimit
from stable_baselines3 import SAC
from stable_baselines3.common.monitor import Monitor

from sb3_piano.callbacks import EpisodeMetricsCallback, F1Callback
from sb3_piano.envs import SELF_ACTUATED_ID
from sb3_piano.interop.environment import DmEnvironment
from sb3_piano.metrics import frame_f1

STEPS = 6
F1_KEYS = ("f1", "onset_f1", "noop_f1")


class Stop(gym.Wrapper):
    """A wrapper that nobody knows: it ends episodes by steps of its own count."""

    count = 0

    def reset(self, **options):
        self.count = 0
        return self.env.reset(**options)

    def step(self, action):
        observation, reward, terminated, _, info = self.env.step(action)
        self.count += 1
        return observation, reward, terminated, self.count == STEPS, info


def piano(**options):
    return gym.make(SELF_ACTUATED_ID, physics="fast", **options)


class OtherLimit(Stop):
    """A time limit of another package, such as the one that RL Zoo puts in gymnasium's place."""

    _max_episode_steps = STEPS
    _elapsed_steps = property(lambda self: self.count)


LIMITED = {
    "make": lambda: piano(max_episode_steps=STEPS),
    "wrapper": lambda: TimeLimit(piano(), STEPS),
    "two wrappers": lambda: TimeLimit(TimeLimit(piano(), STEPS), 99),
    "of another package": lambda: OtherLimit(piano()),
    "around Monitor": lambda: TimeLimit(Monitor(piano()), STEPS),
}
ENDED = {**LIMITED, "another wrapper": lambda: Stop(piano())}


def play(env):
    """Play to the limit with the goal's own keys in every other step; return the infos."""
    env.reset(seed=0)
    infos = []
    for step in range(STEPS):
        action = np.full(env.action_space.shape, -1.0, dtype=np.float32)
        action[:88] += 2 * env.unwrapped.roll.active[step] * (step % 2)
        *_, truncated, info = env.step(action)
        infos.append(info)
    assert truncated
    return infos


@pytest.mark.parametrize("kind", LIMITED)
def test_the_last_info_at_a_time_limit_has_the_metrics_of_the_steps_played(kind):
    env = LIMITED[kind]()
    *before, last = play(env)
    inner = env.unwrapped
    assert all(set(info) == {"reward_terms"} for info in before)
    assert {name: last[name] for name in inner.summary} == inner.summary
    played = inner.performance
    assert last["f1"] == frame_f1(inner.roll.active[:STEPS], played.key_active)
    assert last["noop_f1"] == 1 - inner.roll.active[:STEPS].any(axis=1).mean()
    assert 0 < last["f1"] != last["noop_f1"]


def test_the_episode_after_a_time_limit_is_as_long():
    env = Autoreset(LIMITED["wrapper"]())
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[3] for _ in range(2 * STEPS + 1)]
    assert np.flatnonzero(ends).tolist() == [STEPS - 1, 2 * STEPS]


@pytest.mark.parametrize("kind", ENDED)
def test_a_monitor_around_it_writes_the_metrics(kind):
    env = Monitor(ENDED[kind](), info_keywords=F1_KEYS)
    episode = play(env)[-1]["episode"]
    assert {name: episode[name] for name in F1_KEYS} == {
        name: env.unwrapped.summary[name] for name in F1_KEYS
    }


def test_a_process_of_stable_baselines3_sends_them():
    info = play(ENDED["another wrapper"]())[-1]
    assert not set(F1_KEYS) & set(pickle.loads(pickle.dumps(info)))
    info["terminal_observation"] = None  # as its worker does before it sends the info
    assert set(F1_KEYS) <= set(pickle.loads(pickle.dumps(info)))


@pytest.mark.parametrize("autoreset", ["NextStep", "SameStep"])
@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_gymnasiums_vectors_have_them(mode, autoreset):
    options = {"physics": "fast", "max_episode_steps": STEPS}
    if mode == "sync":
        options["vector_kwargs"] = {"autoreset_mode": AutoresetMode(autoreset)}
    else:
        options["autoreset_mode"] = autoreset
    venv = gym.make_vec(SELF_ACTUATED_ID, 2, mode, **options)
    venv.reset(seed=0)
    for _ in range(STEPS):
        *_, truncated, infos = venv.step(np.zeros(venv.action_space.shape, dtype=np.float32))
    assert truncated.all()
    assert infos.get("final_info", infos)["_f1"].all()
    venv.close()


def test_metrics_of_dm_envs_time_steps():
    env = DmEnvironment(Stop(piano()))
    env.reset()
    for _ in range(STEPS):
        env.step(np.zeros(env.action_spec().shape))
    assert set(F1_KEYS) <= set(env.get_musical_metrics())


def test_copies_of_an_info_are_plain_and_hold_what_it_holds():
    env = Stop(piano())
    info = play(env)[0]
    for copied in (copy.deepcopy(info), pickle.loads(pickle.dumps(info)), dict(info)):
        assert type(copied) is dict
        assert copied == info
    with pytest.raises(KeyError):  # the episode has gone on
        info["f1"]


@pytest.mark.parametrize("kind", ENDED)
def test_callbacks_log_them(kind):
    env = ENDED[kind]() if kind == "around Monitor" else Monitor(ENDED[kind]())
    model = SAC(
        "MlpPolicy", env, learning_starts=99, buffer_size=99, policy_kwargs={"net_arch": [2]}
    )
    evaluation = F1Callback(eval_freq=STEPS)
    model.learn(STEPS, callback=[evaluation, EpisodeMetricsCallback()])
    assert set(F1_KEYS) <= set(evaluation.evaluations_metrics[0][0])
    assert "music/f1" in model.logger.name_to_value
