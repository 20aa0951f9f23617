"""Offsets in the mirror: what the actuators are told, and back; rewards by hand."""

import gymnasium as gym
import numpy as np
import pytest
from episodes import at_random, play_episode, steps_of
from gymnasium.wrappers import RescaleAction
from short_scores import score_of
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, InvalidActionError
from sb3_piano.music import Score
from sb3_piano.planning import PlanSettings
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.vec_env import HandsAsAgents
from sb3_piano.wrappers import HandActions, HandReward
from sb3_piano.wrappers.hand_actions import change_of_actions

PIECE = score_of(
    (0.0, 0.3, 64, 1), (0.3, 0.6, 67, 3), (0.2, 0.6, 48, 6), pedals=[(0.25, 0.5)], title="two hands"
)
OPTIONS = {"physics": "fast", "reduced_action_space": False, "initial_buffer_time": 0.5}


def piano(**changes):
    return PianoEnv(PIECE, **{"observation": "hands", **OPTIONS, **changes})


def test_no_offset_stays_where_the_hands_are_and_the_pedal_follows_the_score():
    env = HandActions(piano())
    env.reset()
    pedals = []
    for _ in range(len(env.unwrapped.roll)):
        env.step(np.zeros(44))
        pedals.append(env.unwrapped.pedal_down)
    np.testing.assert_array_equal(pedals, env.unwrapped.roll.sustain)
    assert np.abs(env.unwrapped.data.qpos[env.unwrapped.scene.hand_qpos]).max() < 0.2


def test_the_same_action_moves_both_hands_alike_in_the_mirror():
    env = HandActions(piano())
    env.reset()
    bare, scene = env.unwrapped, env.unwrapped.scene
    action = np.random.default_rng(0).uniform(-0.2, 0.2, 22)
    for _ in range(3):
        env.step(np.tile(action, 2))
    right, left = (bare.data.qpos[address].copy() for address in scene.joint_qpos)
    left[-2] *= -1
    np.testing.assert_allclose(right, left, atol=1e-3)
    assert abs(right[-2]) > 1e-3


def test_controls_become_actions_and_back():
    env = HandActions(piano())
    env.reset()
    scene, random = env.unwrapped.scene, np.random.default_rng(1)
    for _ in range(5):
        controls = random.uniform(scene.ctrl_low, scene.ctrl_high)
        near = np.abs(
            controls - scene.actuator_positions(env.unwrapped.data.qpos[scene.hand_qpos])
        ) <= np.abs(env.reach)
        told, _ = env.unwrapped.action_map.controls(env.piano_action(env.action_for(controls)))
        np.testing.assert_allclose(told[near], controls[near], atol=1e-6)
        assert near.mean() > 0.5
        env.step(env.action_for(controls))


@pytest.mark.slow
def test_the_planned_pianist_plays_as_well_through_it():
    env = HandActions(piano())
    inside = env.unwrapped
    tracker = PlannedPianist(inside)._trackers

    def choose(_):
        positions = inside.scene.actuator_positions(inside.data.qpos[inside.scene.hand_qpos])
        controls = tracker.of(inside).controls(inside.steps_played, positions)
        return env.action_for(controls)

    *_, (*_, info) = steps_of(env, choose)
    plain = piano()
    told = play_episode(plain, PlannedPianist(plain))
    assert info["f1"] == pytest.approx(told["f1"], abs=0.02)
    assert info["f1"] > 0.8


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigError, match="reach is 0"):
        HandActions(piano(), reach=0)
    with pytest.raises(ConfigError, match="guidance is -1"):
        HandReward(piano(), guidance=-1)
    rescaled = RescaleAction(piano(), 0.0, 1.0)
    with pytest.raises(ConfigError, match="HandActions cannot replace actions"):
        HandActions(rescaled)
    with pytest.raises(ConfigError, match="A test finds no HandActions around the piano"):
        change_of_actions(rescaled, 0.03, "A test")
    env = HandActions(piano())
    env.reset()
    with pytest.raises(InvalidActionError, match=r"shape \(45,\): expected \(44,\)"):
        env.step(np.zeros(45))
    with pytest.raises(InvalidActionError, match="Element 0 of the action is nan"):
        env.step(np.full(44, np.nan))
    with pytest.raises(InvalidActionError, match="Element 43 of the action is -inf"):
        env.step(np.append(np.zeros(43), -np.inf))


def played(env, player_of=None):
    """Return what both hands earn in each step of a piece, resting or played by the planner."""
    player = player_of and player_of(env.unwrapped)

    def choose(observation):
        return env.unwrapped.rest_action if player is None else player.predict(observation)[0]

    earned = []
    for _, reward, *_, info in steps_of(env, choose):
        np.testing.assert_allclose(reward, info["hand_rewards"].mean())
        earned.append(info["hand_rewards"])
    return np.array(earned), info


def planned(env):
    """Return a pianist whose plan is made fast, and good enough for this piece."""
    return PlannedPianist(env, PlanSettings(rounds=2, iterations=8, dynamic_iterations=4))


class Wild:
    """Plays at random."""

    def __init__(self, env):
        self._choose = at_random(env)

    def predict(self, observation):
        return self._choose(observation), None


@pytest.mark.parametrize("goal_time", ["beginning", "end"])
def test_each_hand_is_told_how_its_keys_are_played(goal_time):
    env = HandReward(piano(goal_time=goal_time), within=0.0, strikes=0.0)
    rested, _ = played(env)
    roll = env.unwrapped.asked_roll
    for side in (0, 1):
        own = (roll.finger // 5 == side) & roll.active
        expected = np.where(own.any(axis=1), -1.0, np.where(roll.active.any(axis=1), -0.4, 0.0))
        np.testing.assert_allclose(rested[:, side], expected)
    well, info = played(env, planned)
    assert info["f1"] > 0.8
    # A plan strikes at onsets, which is a step late for goals at the end.
    assert well.sum() > (0.2 if goal_time == "beginning" else 0.3) * rested.sum()


@pytest.mark.parametrize("player_of", [planned, Wild])
def test_strikes_count_when_they_are_in_time(player_of):
    plain, _ = played(HandReward(piano(), strikes=0.0), player_of)
    env = HandReward(piano(), strikes=1.0)
    struck, info = played(env, player_of)
    hits = info["onset_recall"] * len(PIECE.notes)
    expected = hits - (len(env.unwrapped.performance.strike_time) - hits)
    gained = (struck - plain).sum()
    # Of wild playing it counts keys, too, that bounce within a control step.
    assert gained == pytest.approx(expected) if player_of is planned else gained <= expected
    assert (expected > 0) == (player_of is planned)


def test_guidance_is_what_the_piano_s_own_terms_say_of_the_hand_that_has_to_play():
    score = Score(notes=[note for note in PIECE.notes if note.finger < 5], title="a right hand")

    def env(guidance, fingering, **options):
        piano = PianoEnv(score, observation="hands", **OPTIONS, **options)
        return HandReward(piano, strikes=0.0, guidance=guidance, fingering=fingering)

    for goal_time, weight in (("beginning", 1.0), ("end", 0.25)):
        guided = env(2.0, weight, goal_time=goal_time)
        plain = env(0.0, weight, goal_time=goal_time)
        bare = guided.unwrapped
        plain.reset(seed=0)
        observation, _ = guided.reset(seed=0)
        player, asked = planned(bare), bare.asked_roll
        seen = []
        for step in range(len(asked)):
            action, _ = player.predict(observation)
            observation, *_, info = guided.step(action)
            terms, rewards = info["reward_terms"], info["hand_rewards"]
            gained = rewards - plain.step(action)[-1]["hand_rewards"]
            sounding = np.frombuffer(bare.simulation.sounding, dtype=bool)
            wrong = (sounding & ~asked.active[step]).any()
            held = 2 * terms["key_press"] - (not wrong)
            due = asked.active[step].any()
            expected = weight * terms["fingering"] + held if due else 0.0
            np.testing.assert_allclose(gained, [expected, 0.0], atol=1e-9)
            seen.append(expected)
        assert min(seen) == 0.0
        assert max(seen) > 0.9 * (1 + weight)


def test_hands_are_agents_with_half_of_everything_each():
    def make():
        return HandActions(HandReward(piano()))

    venv, plain = HandsAsAgents(DummyVecEnv([make, make])), DummyVecEnv([make, make])
    assert venv.num_envs == 4
    assert venv.action_space.shape == (22,)
    halves, whole = venv.reset(), plain.reset()
    np.testing.assert_array_equal(halves.reshape(2, -1), whole)
    random = np.random.default_rng(0)
    ended = 0
    for _ in range(30):
        actions = random.uniform(-0.2, 0.2, (4, 22)).astype(np.float32)
        halves, rewards, dones, infos = venv.step(actions)
        whole, both, over, told = plain.step(actions.reshape(2, 44))
        np.testing.assert_array_equal(halves.reshape(2, -1), whole)
        np.testing.assert_allclose(rewards.reshape(2, 2).mean(axis=1), both, atol=1e-6)
        np.testing.assert_array_equal(dones.reshape(2, 2), np.stack([over, over], axis=1))
        for index in np.flatnonzero(dones):
            last = told[index // 2]["terminal_observation"].reshape(2, -1)[index % 2]
            np.testing.assert_array_equal(infos[index]["terminal_observation"], last)
            ended += 1
    assert ended == 4
    assert venv.get_attr("metadata", [3]) == plain.get_attr("metadata", [1])
    others = (
        lambda: PianoEnv(PIECE),
        lambda: PianoEnv(PIECE, hands_in_scene="none"),
        lambda: gym.make("Pendulum-v1"),
    )
    for other in others:
        with pytest.raises(ConfigError, match="HandsAsAgents cannot give each hand a part"):
            HandsAsAgents(DummyVecEnv([other]))
    with pytest.raises(ConfigError, match="no reward of each hand: expected sb3_piano.wrappers.H"):
        HandsAsAgents(DummyVecEnv([make, lambda: HandActions(piano())]))
