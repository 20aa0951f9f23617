"""One text says who plays; one loop plays."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.vec_env import DummyVecEnv
from yaml_rows import Tables

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.planning import PlanSettings
from sb3_piano.players import (
    PLAYERS,
    EpisodeRecorder,
    PlayerSpec,
    TreeSearch,
    TreeSettings,
    rollout,
)
from sb3_piano.players.planned import PlannedPianist

tables = Tables(__file__)


@pytest.fixture
def piano():
    return PianoEnv("scale-CMajor", physics="fast", control_timestep=0.25)


class Rest:
    """Rests, and counts how often it is asked."""

    def __init__(self, action):
        self.action = action
        self.asked = []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        self.asked.append((state, bool(episode_start[0])))
        return self.action, (state or 0) + 1


@pytest.mark.parametrize(
    ("text", "name", "arguments", "tree"),
    [
        *((name, name, {}, None) for name in PLAYERS),
        *tables["a_text_says_who_plays_with_which_settings"],
    ],
)
def test_a_text_says_who_plays_with_which_settings(text, name, arguments, tree):
    spec, default = PlayerSpec.parse(text), TreeSettings()
    assert (spec.name, spec.arguments) == (name, arguments)
    assert spec.tree == (default if tree == "DEFAULT" else tree and TreeSettings.parse(tree))
    assert PlayerSpec.parse(str(spec)) == spec
    assert spec.is_run == text.startswith("runs")


def test_files_and_folders_are_players(tmp_path):
    assert PlayerSpec.parse(tmp_path) == PlayerSpec(name=str(tmp_path))
    file = tmp_path / "net.safetensors"
    file.touch()
    assert PlayerSpec.parse(file) == PlayerSpec(name="sight-reader", arguments={"model": str(file)})
    assert PlayerSpec.parse(file).file == str(file)


@tables("text, message")
def test_what_is_no_player_is_told(text, message):
    with pytest.raises(ConfigError, match=message):
        PlayerSpec.parse(text)


def test_settings_of_the_plan_may_be_given_to_whoever_follows_one(piano):
    player = PlayerSpec.parse("planned:hover=0.02,rounds=3").make(piano)
    assert player.settings == PlanSettings(hover=0.02, rounds=3)
    spec = PlayerSpec(name="sampling", arguments={"plan_settings": {"rounds": 2}, "noise": None})
    assert spec.make(piano)._trackers.settings == PlanSettings(rounds=2)
    looking = PlayerSpec.parse("tree:2x1:planned").make(piano)
    assert isinstance(looking, TreeSearch)
    assert isinstance(looking._model, PlannedPianist)
    with pytest.raises(
        ConfigError, match="plays in its own environment: .* or sb3_piano.training.OpenPlayer.open"
    ):
        PlayerSpec.parse("runs/none").make(piano)
    with pytest.raises(ConfigError, match="samples is 'many': expected a whole number"):
        PlayerSpec.parse("sampling:samples=many,nominal=none").make(piano)


def test_a_roll_out_gives_each_episode_when_it_has_ended(piano):
    player, steps = Rest(piano.rest_action), []
    played = rollout(player, piano, episodes=2, seed=3, on_step=steps.append)
    first = next(played)
    length = len(piano.roll)
    assert (first.metrics["length"], len(steps), first.title) == (length, length, "scale-CMajor")
    assert player.asked[:2] == [(None, True), (1, False)]
    assert len(list(played)) == 1
    assert player.asked[length][1], "the second episode begins"
    assert np.array_equal(steps[0].after, steps[1].observation)
    assert sum(one.reward for one in steps[:length]) == pytest.approx(first.metrics["return"])


def test_a_vector_of_one_is_played_like_its_environment(piano):
    alone = next(rollout(Rest(piano.rest_action), piano, seed=3))
    venv = DummyVecEnv([lambda: EpisodeRecorder(piano)])
    rows = Rest(piano.rest_action[None])
    in_vector = list(rollout(rows, venv, episodes=2, seed=3))
    assert in_vector[0].metrics == alone.metrics
    assert len(in_vector) == 2


def test_what_is_played_may_be_disturbed_and_is_told_apart_from_what_was_chosen(piano):
    down = np.ones_like(piano.rest_action)
    steps = []
    played = rollout(
        Rest(piano.rest_action), piano, disturb=lambda seen, chosen: down, on_step=steps.append
    )
    assert next(played).motion.actions[0] == pytest.approx(down)
    assert (steps[0].label == piano.rest_action).all()
    assert (steps[0].action == down).all()


def test_resting_hands_need_no_player_and_a_wrapper_may_end_an_episode(piano):
    player = Rest(np.ones_like(piano.rest_action))
    resting = next(rollout(player, piano, resting=True))
    assert len(player.asked) == 1
    assert (resting.motion.actions == piano.rest_action).all()
    played = rollout(Rest(piano.rest_action), TimeLimit(EpisodeRecorder(piano), 4), episodes=2)
    assert [one.metrics["length"] for one in played] == [4, 4]
    for name, number in (("episodes", 0), ("seed", -1)):  # checked at once
        with pytest.raises(ConfigError, match=f"{name} is {number}"):
            rollout(Rest(None), piano, **{name: number})


def test_other_environments_are_played_too():
    class Push:
        def predict(self, observation, *arguments, **named):
            return 1, None

    with gym.make("CartPole-v1") as env:
        (one,) = rollout(Push(), env, seed=0)
    assert one.performance is None
    assert one.metrics["return"] == one.metrics["length"] > 5
