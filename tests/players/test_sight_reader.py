"""The sight-reader: the same network in NumPy as in torch, in every environment that it is for."""

import dataclasses
import warnings

import gymnasium as gym
import numpy as np
import pytest
import torch
from episodes import play_episode
from stable_baselines3 import TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_piano.callbacks import HandWeightsCallback
from sb3_piano.envs import Block, PianoEnv
from sb3_piano.exceptions import ConfigError, PlanWarning
from sb3_piano.lab.music.corpus import HELD_OUT
from sb3_piano.music import Note, Score, load_score
from sb3_piano.players import HandModel, SightReader, make_player
from sb3_piano.players.hand_model import SHIPPED
from sb3_piano.policies import (
    HandsActorCriticPolicy,
    HandsSACPolicy,
    HandsTD3Policy,
    set_standardization,
)
from sb3_piano.policies.hand_network import HandHead
from sb3_piano.wrappers import HandActions, KeyRange

POLICIES = (HandsSACPolicy, HandsTD3Policy, HandsActorCriticPolicy)
IN = {"reduced_action_space": False, "initial_buffer_time": 0.2, "physics": "fast"}


def score(*notes, length=0.2, title="tune"):
    """Return a score of (pitch, finger), one after the other, or of tuples of these at once."""
    made = []
    for i, chord in enumerate(notes):
        for pitch, finger in chord if isinstance(chord[0], tuple) else (chord,):
            onset = i * length
            made.append(Note(onset=onset, offset=onset + length, pitch=pitch, finger=finger))
    return Score(notes=made, title=title)


TUNE = score((72, 0), ((76, 2), (52, 6)), (79, 4), (48, 8))


def piano(piece=TUNE, **options):
    return PianoEnv(piece, **{**IN, **options})


def hands(piece=TUNE, **options):
    return HandActions(piano(piece, observation="hands", fingering="robot", **options))


def policy_of(kind, env, activation=torch.nn.SiLU, net_arch=(32, 16)):
    """Return a policy whose actions are anywhere in their range."""
    torch.manual_seed(3)
    policy = kind(
        env.observation_space,
        env.action_space,
        lambda _: 1e-4,
        activation_fn=activation,
        net_arch={"pi": list(net_arch), "qf": [8], "vf": [8]},
    )
    size, random = env.observation_space.shape[0] // 2, np.random.default_rng(0)
    set_standardization(policy, random.normal(size=size), random.uniform(0.2, 3.0, size=size))
    for name, parameter in policy.named_parameters():
        if "norm" in name:
            torch.nn.init.normal_(parameter, 0.5, 0.5)
    for module in policy.modules():
        if isinstance(module, HandHead):
            torch.nn.init.normal_(module.weight, 0.0, 0.02)
    return policy


@pytest.fixture(scope="module")
def model():
    env = hands()
    return HandModel.of(policy_of(HandsTD3Policy, env), env, 7, data="none")


def play(env, player):
    """Play an episode; return its final info, all actions and the hands' motion."""
    observation, _ = env.reset(seed=0)
    state, over, info, actions, motion = None, False, {}, [], []
    while not over:
        action, state = player.predict(observation, state)
        actions.append(action)
        observation, _, terminated, truncated, info = env.step(action)
        motion.append(env.unwrapped.data.qpos.copy())
        over = terminated or truncated
    return info, np.array(actions), np.array(motion)


@pytest.mark.parametrize("activation", [torch.nn.SiLU, torch.nn.ReLU, torch.nn.Tanh])
@pytest.mark.parametrize("kind", POLICIES)
def test_it_acts_as_the_policy_in_torch_that_it_was_made_of(kind, activation, tmp_path):
    env = hands()
    policy = policy_of(kind, env, activation)
    HandModel.of(policy, env, 7, data="none").save(tmp_path / "hand.safetensors")
    model = HandModel.load(tmp_path)  # the folder
    assert (model.facts.num_timesteps, model.facts.about) == (7, {"data": "none"})
    assert (model.facts.reach, model.facts.control_timestep) == (1.2, 0.05)
    for network in (model, HandModel.load(SHIPPED)):
        assert network.facts.observation_version == env.unwrapped.config.hands_version == 1
    observations = np.random.default_rng(1).normal(size=(30, *env.observation_space.shape)) * 3
    acted = np.stack([model.act(one) for one in observations])
    expected, _ = policy.predict(observations.astype(np.float32), deterministic=True)
    np.testing.assert_allclose(acted, expected, atol=1e-5)
    assert 0.1 < np.abs(expected).mean() < 0.9, "neither nothing nor the ends"


def test_it_plays_the_same_whenever_keys_are_asked_for_and_where_other_blocks_are_observed(model):
    motions = [
        play(env, SightReader(env, model))[2]
        for env in (hands(), hands(goal_time="end"), hands(observation_blocks=[Elbow]))
    ]
    np.testing.assert_array_equal(motions[1], motions[0])
    np.testing.assert_allclose(motions[2], motions[0], atol=1e-6)
    env = KeyRange(piano(), "piece", simulated=True)  # where only some keys move
    assert len(play(env, SightReader(env, model))[1]) == len(env.unwrapped.roll)


def test_it_plays_the_same_whatever_is_observed_and_whatever_the_actions_are(model):
    env = hands()
    info, actions, motion = play(env, SightReader(env, model))
    assert info["f1"] > 0, "it presses some of the keys"
    np.testing.assert_allclose(actions[0], model.act(env.reset(seed=0)[0]), atol=1e-6)
    wider = HandActions(piano(fingering="robot"), reach=2.0)
    for other in (piano(), piano(observation="fingers"), gym.wrappers.TimeLimit(wider, 99)):
        player = SightReader(other, model)
        found, acted, moved = play(other, player)
        assert acted.shape[1:] == other.action_space.shape
        np.testing.assert_allclose(moved[:8], motion[:8], atol=1e-5)
        assert found["f1"] == pytest.approx(info["f1"], abs=0.02)
    assert player.num_timesteps == 7


def test_it_plays_the_same_where_either_version_of_the_hands_is_observed(model, tmp_path):
    newest, envs = model.newest(), [hands(), hands(hands_version=2)]
    assert newest.newest() is newest
    motions = [
        play(env, SightReader(env, network))[2] for env in envs for network in (model, newest)
    ]
    for motion in motions[1:]:
        np.testing.assert_allclose(motion, motions[0], atol=1e-6)
    policy = policy_of(HandsTD3Policy, envs[1])
    made = HandModel.of(policy, envs[1])
    made.save(tmp_path / "hand.safetensors")
    assert HandModel.load(tmp_path).facts.observation_version == 2
    assert made.facts.blocks == newest.facts.blocks
    a, b = (play(env, SightReader(env, made))[2] for env in envs)
    np.testing.assert_allclose(a, b, atol=1e-6)


@pytest.mark.parametrize("newest", [False, True])
def test_its_weights_are_a_beginning_for_either_version_of_the_hands(model, newest, tmp_path):
    model.save(tmp_path / "hand.safetensors")
    env = hands(hands_version=2 if newest else 1)
    learner = TD3(
        HandsTD3Policy,
        env,
        buffer_size=10,
        policy_kwargs={"activation_fn": torch.nn.SiLU, "net_arch": {"pi": [32, 16], "qf": [8]}},
    )
    HandWeightsCallback(str(tmp_path)).init_callback(learner)
    assert HandModel.of(learner.policy, env).tensors.keys() == model.tensors.keys()
    observation, _ = env.reset(seed=0)
    expected, _ = SightReader(env, model).predict(observation)
    np.testing.assert_allclose(learner.predict(observation)[0], expected, atol=1e-5)


def test_it_plays_several_environments_and_one_piece_after_the_other(model):
    other = score((76, 2), (74, 1), (72, 0), title="other")
    single = piano()
    expected = []
    for piece in (TUNE, other):
        observation, _ = single.reset(options={"score": piece})
        expected.append(SightReader(single, model).predict(observation)[0])
    assert np.abs(expected[0] - expected[1]).max() > 0.01
    venv = VecNormalize(DummyVecEnv([piano, lambda: piano(other)]), norm_reward=False)
    player = SightReader(venv, model)
    np.testing.assert_array_equal(player.predict(venv.reset())[0], expected)
    player = SightReader(single, model)
    for piece, action in zip((TUNE, other, TUNE), (*expected, expected[0]), strict=True):
        observation, _ = single.reset(options={"score": piece})
        np.testing.assert_array_equal(player.predict(observation)[0], action)


def test_notes_without_finger_get_one_and_those_beyond_the_hands_are_told(model):
    plain = Score(notes=[dataclasses.replace(note, finger=-1) for note in TUNE.notes])
    env = piano(plain)
    labelled = piano(plain, fingering="robot")
    np.testing.assert_array_equal(
        SightReader(env, model).predict(env.reset(seed=0)[0])[0],
        SightReader(labelled, model).predict(labelled.reset(seed=0)[0])[0],
    )
    # A thumb cannot hold C4 while the little finger is on C6; six keys are more than five fingers.
    chord = tuple((pitch, -1) for pitch in (60, 62, 64, 65, 67, 69))
    many = score(*[((84, -1), *chord, (36, -1), (38, -1), (40, -1), (41, -1), (43, -1))] * 2)
    for piece, told in (
        (score(((60, 0), (84, 4))), "C4 .* left out by the hand"),
        (many, "no finger is left"),
    ):
        env = piano(piece)
        with pytest.warns(PlanWarning, match=told):
            _, actions, _ = play(env, SightReader(env, model))
        assert len(actions) == len(env.roll)


def test_notes_without_finger_among_others_are_played_whatever_is_observed(model):
    notes = [dataclasses.replace(n, finger=-1 if n.pitch == 76 else n.finger) for n in TUNE.notes]
    actions = []
    for observation in ("roll", "hands"):
        with warnings.catch_warnings():  # an environment that shows hands tells of the note
            warnings.filterwarnings("ignore", ".*no finger is left", PlanWarning)
            env = piano(Score(notes=notes), observation=observation, fingering="keep")
            actions.append(play(env, SightReader(env, model))[1])
    assert len(actions[0])
    np.testing.assert_allclose(*actions, atol=1e-6)


def test_a_network_for_other_environments_is_refused_when_it_is_made(model, tmp_path):
    told = "was trained for a control step, in s, of 0.05, and here it is 0.1: expected"
    with pytest.raises(ConfigError, match=f"The sight-reader {told}"):
        SightReader(piano(control_timestep=0.1), model)
    model.save(tmp_path / "x.safetensors")
    with pytest.raises(ConfigError, match=r"x.safetensors' .* of 22, and here it is 19.*=False,"):
        SightReader(piano(reduced_action_space=True), tmp_path / "x.safetensors")
    blocks = {**model.facts.blocks, "line": 5, "busy": 2}
    changed = HandModel(model.tensors, dataclasses.replace(model.facts, blocks=blocks))
    with pytest.raises(ConfigError, match=r"385 numbers \(.*busy 2, line 5.*here it is 385"):
        SightReader(piano(), changed)
    later = HandModel(model.tensors, dataclasses.replace(model.facts, observation_version=99))
    with pytest.raises(ConfigError, match=r'version of the observation "hands" of 99, and here it'):
        SightReader(piano(), later)
    with pytest.raises(ConfigError, match="unchanged by other wrappers"):
        SightReader(gym.wrappers.RescaleAction(piano(), *np.float32([-0.5, 0.5])), model)


def test_a_file_that_is_no_network_of_a_hand_is_refused(model, tmp_path):
    path = tmp_path / "hand.safetensors"
    with pytest.raises(ConfigError, match=r"hand.safetensors' cannot be read .*: expected a safet"):
        HandModel.load(tmp_path)
    model.save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    with pytest.raises(ConfigError, match="cannot be read"):
        HandModel.load(path)
    path.write_bytes(whole.replace(b"SiLU", b"Siln"))
    with pytest.raises(ConfigError, match="activation is 'Siln': expected one of"):
        HandModel.load(path)
    head = {**model.tensors, "head.bias": model.tensors["head.bias"] * np.float32(np.nan)}
    with pytest.raises(ConfigError, match=r"head.bias has numbers that are not finite"):
        HandModel(head, model.facts)
    less = {n: t for n, t in model.tensors.items() if n != "network.hidden.1.norm.bias"}
    with pytest.raises(ConfigError, match=r"differ .*: network.hidden.1.norm.bias"):
        HandModel(less, model.facts)
    env = gym.make("RoboPianist-debug-CMajorScaleTwoHands-v0")
    with pytest.raises(ConfigError, match="finds no HandActions"):
        HandModel.of(policy_of(HandsTD3Policy, hands()), env)


class Elbow(Block):
    name, meaning = "elbow", "nothing that a hand knows"


def test_the_network_that_is_shipped_plays_a_piece_that_it_never_saw():
    assert "hanon-11" in HELD_OUT
    part = load_score("hanon-11").excerpt(0.0, 4.0)
    env = PianoEnv(part, fingering="robot", reduced_action_space=False, initial_buffer_time=0.5)
    info = play_episode(env, make_player("sight-reader", env))
    assert info["f1"] > 0.85
    assert info["onset_f1"] > 0.6
