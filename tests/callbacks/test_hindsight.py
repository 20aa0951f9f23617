"""Episodes that are relabelled in hindsight: exactly what was played, and nothing lost."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from episodes import as_dict
from scripted import tiny, tiny_ppo
from stable_baselines3 import DQN, SAC, TD3
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnvWrapper, VecNormalize
from yaml_rows import Tables

from sb3_piano.callbacks import HindsightCallback
from sb3_piano.callbacks.own_env import RunContext
from sb3_piano.callbacks.relabelling import Stage
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import Note, PianoRoll, Score
from sb3_piano.vec_env import HandsAsAgents, ProcessVecEnv, ThreadVecEnv
from sb3_piano.wrappers import (
    Excerpt,
    HandActions,
    HandReward,
    HindsightFlag,
    KeyRange,
    Lookahead,
    PitchShift,
    PreviousActionReward,
    RandomPiece,
    TemporalStretch,
)
from sb3_piano.wrappers.residual import Residual

tables = Tables(__file__)


def piece(steps, first=1, pitch=60):
    """Return a piece of so many control steps after its first note, and silence before it."""
    notes = [
        Note(onset=0.05 * first, offset=0.05 * (first + steps), pitch=pitch, finger=0),
        Note(onset=0.05 * first, offset=0.05 * (first + 1), pitch=pitch - 5, finger=6),
    ]
    return Score(notes=notes, title=f"{steps} steps")


def piano(score=None, **options):
    options = {"physics": "fast", "n_steps_lookahead": 2, **options}
    return PianoEnv(score or piece(19), **options)


class Held(gym.Wrapper):
    """Play each action for four control steps, so that keys go down and come up again."""

    def reset(self, **kwargs):
        self.count = 0
        return super().reset(**kwargs)

    def step(self, action):
        if self.count % 4 == 0:
            self.held = action
        self.count += 1
        return super().step(self.held)


class Played(gym.Wrapper):
    """Tell in the last info of an episode what was played."""

    def step(self, action):
        *result, terminated, truncated, info = super().step(action)
        if terminated or truncated:
            info = {**info, "played": self.unwrapped.performance}
        return *result, terminated, truncated, info


class Performances(BaseCallback):
    """Keep what was played, with the environment that played it."""

    def __init__(self):
        super().__init__()
        self.found = []

    def _on_step(self):
        self.found += [
            (i, info["played"]) for i, info in enumerate(self.locals["infos"]) if "played" in info
        ]
        return True


def collecting(envs, algorithm=SAC, vector=DummyVecEnv, **kwargs):
    """Return a model that plays random actions in environments given as functions."""
    venv = vector(envs) if isinstance(envs, list) else envs
    return tiny(venv, algorithm, **{"buffer_size": 20_000, "train_freq": 1, "seed": 3, **kwargs})


def flagged(**options):
    return HindsightFlag(Held(Played(piano(**options))))


def rows(model):
    """Return observations, next ones, actions, rewards, dones and timeouts of all rows."""
    buffer = model.replay_buffer
    names = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
    return {name: getattr(buffer, name)[: buffer.pos] for name in names}


def block(env, observations, name):
    described = env.observation_space.layout[name]
    return observations[..., described.slice].reshape(*observations.shape[:-1], *described.shape)


@pytest.fixture
def relabelled(monkeypatch):
    """Performances of the relabelled episodes, once the training is over."""
    found, original = [], Stage.relabelled

    def spied(stage, episode):
        result = original(stage, episode)
        if result is not None:
            found.append(stage._piano.performance)
        return result

    monkeypatch.setattr(Stage, "relabelled", spied)
    return found


def assert_same_playing(relabelled, original):
    """Check that a relabelled episode plays, and asks for, what was played in the original."""
    steps = len(relabelled)
    assert relabelled.metrics()["f1"] == 1.0
    np.testing.assert_array_equal(relabelled.key_active, original.key_active[:steps])
    np.testing.assert_array_equal(relabelled.roll.active[:steps], original.key_active[:steps])
    np.testing.assert_array_equal(relabelled.roll.sustain[:steps], original.sustain[:steps])
    assert not original.key_active[steps:].any()


def test_where_hands_are_agents_each_has_its_part_of_a_relabelled_episode():
    def one(**options):
        hands = piano(observation="hands", reduced_action_space=False, **options)
        return Held(HandActions(HandReward(Played(hands), guidance=1.0), reach=3.0))

    performances = Performances()
    model = collecting(HandsAsAgents(DummyVecEnv([one])))
    model.learn(2 * 40, callback=[HindsightCallback(), performances], log_interval=10**6)
    played, found = performances.found[0][1], rows(model)  # both hands end with the same
    steps, other = len(played), one(trim_silence=False)
    observation, _ = other.reset(options={"score": played.to_score(by_steps=True)})
    count = min(steps, len(other.unwrapped.roll))
    for row in range(steps, steps + count):
        assert (found["observations"][row] == observation.reshape(2, -1)).all()
        observation, *_, info = other.step(found["actions"][row].reshape(-1))
        assert (found["next_observations"][row] == observation.reshape(2, -1)).all()
        assert (found["rewards"][row] == np.float32(info["hand_rewards"])).all()
    assert (found["dones"][steps + count - 1] == 1).all()
    assert other.unwrapped.performance.metrics()["f1"] == 1.0


@pytest.mark.parametrize("goal_time", ["beginning", "end"])
def test_the_transitions_follow_those_of_the_episode_and_are_the_replay_s(goal_time):
    performances = Performances()
    model = collecting([lambda: flagged(goal_time=goal_time)])
    model.learn(60, callback=[HindsightCallback(), performances], log_interval=10**6)
    all_rows = {name: array[:, 0] for name, array in rows(model).items()}
    env, expected, start = flagged(), [], 0
    for _, played in performances.found:
        steps = len(played)
        assert not block(env, all_rows["observations"][start : start + steps], "relabelled").any()
        assert all_rows["dones"][start + steps - 1] == 1
        actions = all_rows["actions"][start : start + steps]
        other = flagged(trim_silence=False)
        score = dataclasses.replace(played, title="relabelled").to_score(by_steps=True)
        observation, _ = other.reset(options={"score": score})
        other.relabelled = True
        observation[-1] = 1.0
        count = min(steps, len(other.unwrapped.roll))
        for index, action in enumerate(actions[:count]):
            row = {name: array[start + steps + index] for name, array in all_rows.items()}
            np.testing.assert_array_equal(row["observations"], observation)
            observation, reward, *_ = other.step(action)
            np.testing.assert_array_equal(row["next_observations"], observation)
            np.testing.assert_array_equal(row["actions"], action)
            assert row["rewards"] == np.float32(reward)
            assert block(env, row["observations"], "relabelled") == [1]
            assert row["dones"] == row["timeouts"] == (index == count - 1)
            goal = block(env, row["observations"], "goal")[0, :88]
            np.testing.assert_array_equal(goal, played.key_active[index])
        expected.append(count)
        start += steps + count
    assert len(expected) == 3
    assert len(all_rows["dones"]) == start  # 60 steps are three whole episodes
    assert model.logger.name_to_value["hindsight/episodes"] == 3
    sounding = np.mean(
        [
            p.key_active[:n].any(axis=1).mean()
            for (_, p), n in zip(performances.found, expected, strict=True)
        ]
    )
    assert model.logger.name_to_value["hindsight/sounding"] == pytest.approx(sounding)


@pytest.mark.slow
@pytest.mark.parametrize(("vector", "train_freq"), [(DummyVecEnv, 1), (ThreadVecEnv, 7)])
def test_of_two_environments_rows_are_added_when_both_have_some(vector, train_freq):
    def env(steps):
        return HindsightFlag(Held(Played(piano(piece(steps)))))

    performances = Performances()
    envs = [lambda: env(9), lambda: env(23)]
    model = collecting(envs, vector=vector, train_freq=train_freq)
    model.learn(2 * 70, callback=[HindsightCallback(), performances], log_interval=10**6)
    all_rows = rows(model)
    flag = block(env(9), all_rows["observations"], "relabelled")[..., 0]
    np.testing.assert_array_equal(flag[:, 0], flag[:, 1])
    real, added = flag[:, 0] == 0, flag[:, 0] == 1
    assert real.sum() == 70
    lengths = {0: 0, 1: 0}
    for slot in (0, 1):
        played = [p for s, p in performances.found if s == slot]
        expected, start = [], 0
        for one in played:
            score = one.to_score(by_steps=True)
            count = 0 if score is None else min(len(one), len(PianoRoll.from_score(score, 0.05)))
            expected.append(all_rows["actions"][real, slot][start : start + count])
            start += len(one)
        expected = np.concatenate(expected)
        lengths[slot] = len(expected)
        actions = all_rows["actions"][added, slot]
        np.testing.assert_array_equal(actions, expected[: len(actions)])
    assert lengths[0] != lengths[1]
    assert added.sum() == min(lengths.values()) > 30
    # Nothing before the first episode of both is over.
    assert not added[:24].any()


def test_the_transitions_of_the_training_are_those_without_the_callback():
    def make(buffer):
        venv = VecNormalize(DummyVecEnv([flagged] * 2))
        return collecting(venv, replay_buffer_class=buffer)

    plain, model = make(None), make(None)
    plain.learn(60)
    model.learn(60, callback=HindsightCallback())
    found, expected = rows(model), rows(plain)
    real = found["observations"][:, 0, -1] == 0
    assert 0 < real.sum() < len(real)
    for name, array in expected.items():
        np.testing.assert_array_equal(found[name][real], array, name)


# Every key is due for ten control steps, then one of them: what is wrong then was right before.
CLUSTER = Score(
    notes=[Note(onset=0.0, offset=0.5, pitch=pitch, finger=0) for pitch in range(21, 108)]
    + [Note(onset=0.0, offset=1.0, pitch=108, finger=0)]
)
LEFT = Note(onset=0.0, offset=0.3, pitch=48, finger=5)
UNLABELLED = [
    Score(notes=[dataclasses.replace(note, finger=-1) for note in piece(steps).notes])
    for steps in range(12, 20)
]
STACKS = {
    "shifted": ({}, lambda env: PitchShift(env, 3)),
    "stretched": ({}, lambda env: TemporalStretch(env, [0.4, 2])),
    "a part": ({}, lambda env: Excerpt(env, start=0.02, length=0.5)),
    "pieces": ({}, lambda env: PitchShift(RandomPiece(env, [piece(3), piece(30)]), [-5, 5])),
    "silence before": ({"initial_buffer_time": 0.2, "trim_silence": False}, None),
    "for the robot": ({"fingering": "robot"}, None),
    "without labels": ({"fingering": "optimal-transport"}, None),
    "one hand's notes": ({"hands": "right"}, None),
    "one hand": ({"hands_in_scene": "left", "score": Score(notes=[LEFT])}, None),
    "no hand": ({"hands_in_scene": "none"}, None),
    "a step earlier": ({"goal_time": "end", "wrong_press_termination": True}, None),
    "a wrong press": ({"score": CLUSTER, "wrong_press_termination": True}, None),
    "fingers": ({"observation": "fingers"}, None),
    "hands": ({"observation": "hands", "reduced_action_space": False}, HandActions),
    "fingers that are found": (
        {"observation": "fingers", "fingering": "ergonomic"},
        lambda env: RandomPiece(env, UNLABELLED),
    ),
    "few keys": ({}, lambda env: KeyRange(env, 24, outside="hide")),
    "more": ({}, lambda env: PreviousActionReward(Lookahead(env, 20, stride=5, fingers=True))),
}


@pytest.mark.slow
@pytest.mark.parametrize(("options", "wrapper"), STACKS.values(), ids=STACKS)
def test_nothing_changes_the_score_of_what_was_played(options, wrapper, relabelled):
    wrapper = wrapper or (lambda env: env)
    original = Performances()
    model = collecting([lambda: Held(Played(wrapper(piano(**options))))])
    model.learn(60, callback=[HindsightCallback(), original])
    sounded = [played for _, played in original.found if played.key_active.any()]
    assert len(sounded) == len(relabelled) > 0
    for one, other in zip(relabelled, sounded, strict=True):
        if wrapper is HandActions:  # whose pedal goes by the score
            other = dataclasses.replace(other, sustain=np.zeros_like(other.sustain))
        assert_same_playing(one, other)
        if options.get("fingering") != "optimal-transport":
            first = other.presses.first, other.presses.key
            np.testing.assert_array_equal(one.roll.finger[first], other.press_finger[first])
        else:
            assert (one.roll.finger == -1).all()


def test_an_episode_with_keys_that_the_agent_does_not_see_is_left_out(relabelled):
    original = Performances()
    model = collecting([lambda: HindsightFlag(Held(Played(KeyRange(piano(), [50, 66]))))])
    model.learn(100, callback=[HindsightCallback(), original])
    keys = [np.flatnonzero(p.key_active.any(axis=0)) + 21 for _, p in original.found]
    visible = [np.isin(k, range(50, 67)).all() and len(k) for k in keys]
    assert len(relabelled) == sum(map(bool, visible)) < len(keys) == 5
    assert model.replay_buffer.pos == 100 + sum(map(len, relabelled))


def test_an_environment_that_is_far_ahead_waits_for_the_other(monkeypatch):
    monkeypatch.setattr("sb3_piano.callbacks.hindsight._MOST_WAITING", 30)
    callback = HindsightCallback()
    model = collecting([lambda: Held(piano(piece(500))), lambda: Held(piano())])
    model.learn(2 * 100, callback=callback)
    assert model.replay_buffer.pos == 100
    assert not callback._waiting[0]
    assert 30 <= len(callback._waiting[1]) < 30 + 20


class Clock(gym.RewardWrapper):
    """Reward by the number of steps that were played."""

    def reward(self, reward):
        return self.unwrapped.total_steps


class Stretched(gym.ActionWrapper):
    """Actions in another space than from -1 to 1."""

    def __init__(self, env):
        super().__init__(env)
        self.action_space = gym.spaces.Box(0.0, 4.0, env.action_space.shape, dtype=np.float32)

    def action(self, action):
        assert action.min() >= 0
        assert action.max() > 1
        return action / 2 - 1


@pytest.mark.parametrize("train_freq", [1, 7])
def test_actions_and_schedules_are_those_of_the_episode(train_freq):
    noise = NormalActionNoise(np.zeros(39), np.full(39, 0.1))
    model = collecting(
        [lambda: HindsightFlag(Clock(Stretched(Held(piano()))))],
        TD3,
        action_noise=noise,
        learning_starts=30,
        train_freq=train_freq,
    )
    model.learn(70, callback=HindsightCallback())
    all_rows = rows(model)
    added = all_rows["observations"][:, 0, -1] == 1
    pairs = np.column_stack([all_rows["actions"][:, 0], all_rows["rewards"]])
    assert added.sum() > 20
    assert {row.tobytes() for row in pairs[added]} <= {row.tobytes() for row in pairs[~added]}


def test_of_a_training_that_goes_on_only_whole_episodes_are_relabelled(relabelled):
    model = collecting([lambda: Held(Played(piano()))])
    model.learn(5, callback=HindsightCallback())
    original = Performances()
    callbacks = [HindsightCallback(), original]
    model.learn(35, callback=callbacks, reset_num_timesteps=False)
    (_, partial), (_, whole) = original.found
    assert len(partial) == 20
    assert partial.key_active.any()
    (found,) = relabelled
    assert_same_playing(found, whole)


class ByScore(gym.ActionWrapper):
    def action(self, action):
        return action if self.unwrapped.score.title == "relabelled" else -action


class EndedByScore(gym.Wrapper):
    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        ends = self.unwrapped.score.title == "" and self.unwrapped.steps_played == 4
        return observation, reward, terminated or ends, truncated, info


@pytest.mark.parametrize(
    ("wrapper", "message"),
    [
        (ByScore, r"has F1 0\.\d+: expected 1. The environment plays the same"),
        (EndedByScore, "An episode of 20 control steps ended after 4 when it was played again"),
    ],
)
def test_an_environment_that_plays_differently_again_is_an_error(wrapper, message):
    with pytest.raises(RunError, match=message):
        collecting([lambda: wrapper(Held(piano()))]).learn(60, callback=HindsightCallback())


class Corrected(Residual):
    def __init__(self, env):
        super().__init__(env, np.ones(38))

    standardization = None

    def base_action(self, observation):
        return self.unwrapped.rest_action.copy()


class HalfSeen(VecEnvWrapper):
    """Show the first half of what there is to see."""

    def __init__(self, venv):
        half = venv.observation_space.shape[0] // 2
        super().__init__(venv, gym.spaces.Box(-np.inf, np.inf, (half,), np.float32))
        self._half = half

    def reset(self):
        return self.venv.reset()[:, : self._half]

    def step_wait(self):
        observations, *rest = self.venv.step_wait()
        return observations[:, : self._half], *rest


NO_LIMITS = {"handle_timeout_termination": False}
REFUSED = {
    "on-policy": lambda: tiny_ppo(DummyVecEnv([piano]), 8),
    "no piano": lambda: DQN("MlpPolicy", "CartPole-v1", buffer_size=100, device="cpu"),
    "dict": lambda: collecting([lambda: as_dict(piano())]),
    "n steps": lambda: collecting([piano], n_steps=3),
    "memory": lambda: collecting(
        [piano], optimize_memory_usage=True, replay_buffer_kwargs=NO_LIMITS
    ),
    "random": lambda: collecting([lambda: piano(randomize_hand_positions=True)]),
    "corrected": lambda: collecting([lambda: Corrected(piano())]),
    "other space": lambda: collecting(HalfSeen(DummyVecEnv([piano]))),
}


@tables("model, message")
def test_what_cannot_be_relabelled_is_refused_when_training_starts(model, message):
    with pytest.raises(ConfigError, match=f"(?s){message}"):
        REFUSED[model]().learn(8, callback=HindsightCallback())


@pytest.mark.slow
def test_environments_in_processes_are_played_again_in_one_of_the_run(tmp_path, relabelled):
    callback = HindsightCallback()
    run = RunContext(folder=tmp_path, make_env=lambda innermost: DummyVecEnv([flagged]))
    callback.use_run(run)
    model = collecting([flagged] * 2, vector=ProcessVecEnv)
    original = Performances()
    model.learn(2 * 45, callback=[callback, original])
    model.get_env().close()
    assert len(relabelled) == 4
    for one, (_, other) in zip(relabelled, original.found, strict=True):
        assert_same_playing(one, other)
