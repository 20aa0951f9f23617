"""Predictive sampling plays what it found, and disturbs nothing."""

import copy
import dataclasses

import numpy as np
import pytest
from episodes import play_episode
from sampling_parts import HELD, TUNE, UNLABELLED, WEAK, make_env, make_player, make_search, play
from stable_baselines3.common.vec_env import DummyVecEnv
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError, EnvStateError
from sb3_piano.music import Score
from sb3_piano.planning.sampling import SamplingCost, SamplingNoise
from sb3_piano.players.planned import PlannedPianist

tables = Tables(__file__)


def test_actions_are_those_of_the_action_space_however_wild_the_noise():
    env = make_env()
    wild = SamplingNoise(finger=9, wrist=9, forearm=1)
    for action in play(env, make_player(env, noise=wild, cost=SamplingCost(effort=0)), 4):
        assert env.action_space.contains(action)


def test_equal_seeds_play_alike_and_others_do_not():
    played = [play(e := make_env(), make_player(e, seed=seed), 4) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(played[0], played[1])
    assert np.abs(played[0] - played[2]).max() > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("physics", [None, "reference"])
def test_the_number_of_threads_makes_no_difference(physics):
    played = [
        play(e := make_env(), make_player(e, n_threads=n, samples=5, physics=physics), 3)
        for n in (1, 2, 9)
    ]
    np.testing.assert_array_equal(played[0], played[1])
    np.testing.assert_array_equal(played[0], played[2])


def everything_in(data):
    arrays = {name: getattr(data, name) for name in dir(data) if not name.startswith("_")}
    return {k: v.copy() for k, v in arrays.items() if isinstance(v, np.ndarray)}


@pytest.mark.slow
@pytest.mark.parametrize("physics", [None, "reference"])
def test_the_environment_is_left_as_it_is(physics):
    env = make_env()
    player = make_player(env, physics=physics, n_threads=2)
    play(env, player, 3)
    before, random = everything_in(env.data), copy.deepcopy(env.np_random.bit_generator.state)
    player.predict(np.zeros(env.observation_space.shape))
    after = everything_in(env.data)
    assert len(before) > 50
    for name, array in before.items():
        np.testing.assert_array_equal(after[name], array, err_msg=name)
    assert env.np_random.bit_generator.state == random
    assert env.steps_played == 3


@pytest.mark.slow
@pytest.mark.parametrize("labelled", [True, False])
def test_from_zero_it_plays_more_than_resting_hands_do(labelled):
    fingers = [note.finger if labelled else -1 for note in HELD]
    notes = [dataclasses.replace(n, finger=f) for n, f in zip(HELD, fingers, strict=True)]
    env = make_env(Score(notes=notes), initial_buffer_time=0.3)
    resting = play_episode(env, make_player(env, samples=1))["f1"]
    sampled = play_episode(env, make_player(env, samples=20, horizon=5))["f1"]
    assert sampled > resting + 0.2


@pytest.mark.slow
def test_a_single_candidate_with_a_plan_is_the_planned_pianist():
    env = make_env(initial_buffer_time=0.3)
    player = make_player(env, nominal="plan", plan_settings=WEAK, samples=1, horizon=1)
    sampled = play(env, player, 8)
    env.reset()
    planned = play(env, PlannedPianist(env, WEAK), 8)
    np.testing.assert_allclose(sampled, planned, atol=1e-6)


@pytest.mark.slow
def test_around_a_plan_that_presses_no_key_down_it_plays_nearly_all():
    env = make_env(Score(notes=HELD), initial_buffer_time=0.3)
    planned = play_episode(env, PlannedPianist(env, WEAK))["f1"]
    player = make_player(env, nominal="plan", plan_settings=WEAK, horizon=6)
    assert play_episode(env, player)["f1"] > planned + 0.5


def test_the_pedal_follows_the_score():
    env = make_env()
    play(env, make_player(env, samples=1, horizon=1), len(env.roll))
    np.testing.assert_array_equal(env.performance.sustain, env.roll.sustain)
    assert 0 < env.roll.sustain.sum() < len(env.roll)


@pytest.mark.parametrize(
    ("goes_on", "physics"),
    [
        ("a new episode", None),
        ("a state that was put back", None),
        ("rigid keys", None),
        ("rigid keys", "reference"),
    ],
)
def test_a_change_is_gone_when_the_episode_went_elsewhere(goes_on, physics):
    env = make_env()
    player = make_player(env, samples=6, physics=physics)
    play(env, player, 2)
    state = env.get_state()
    play(env, player, 3)
    if goes_on == "rigid keys":
        env.fix_keys(20, 70)
    if goes_on == "a state that was put back":
        env.set_state(state)
    else:
        env.reset()
    fresh = make_player(env, samples=6, physics=physics)
    fresh._random = copy.deepcopy(player._random)
    observation = np.zeros(env.observation_space.shape)
    np.testing.assert_array_equal(player.predict(observation)[0], fresh.predict(observation)[0])


def test_changes_to_the_model_are_simulated():
    played = []
    for stiffness in (1.0, 30.0):
        env = make_env()
        env.model.actuator_gainprm[:] *= stiffness
        played.append(make_search(env)[1].rate(env, np.ones((1, 3, env.model.nu))).cost)
    assert played[0] != pytest.approx(played[1], rel=1e-3)


def test_each_of_several_environments_is_played_as_alone_and_equal_ones_otherwise():
    scores = (TUNE, UNLABELLED, TUNE)
    vec = DummyVecEnv([lambda s=s: make_env(s) for s in scores])
    observations, player, state, played = vec.reset(), make_player(vec), None, []
    for _ in range(3):
        actions, state = player.predict(observations, state)
        played.append(actions)
        observations = vec.step(actions)[0]
    alone = make_env()
    np.testing.assert_array_equal(np.array(played)[:, 0], play(alone, make_player(alone), 3))
    for other in played[-1][1:]:
        assert np.abs(played[-1][0] - other).max() > 0.01


def test_steps_of_another_environment_are_refused():
    env, other = make_env(), make_env()
    player = make_player(env)
    _, state = player.predict(other.reset()[0])
    observation = other.step(other.rest_action)[0]
    with pytest.raises(EnvStateError, match="control step 1 is asked for.* is in step 0"):
        player.predict(observation, state)


def test_after_the_last_step_there_is_no_action():
    env = make_env()
    player = make_player(env, samples=1, horizon=1)
    play(env, player, len(env.roll))
    with pytest.raises(EnvStateError, match=r"All \d+ control steps are played: call reset"):
        player.predict(np.zeros(env.observation_space.shape))


@tables("options, message")
def test_wrong_arguments_are_named(options, message):
    with pytest.raises(ConfigError, match=message):
        make_player(make_env(), **options)


def test_a_physics_profile_that_does_not_fit_the_control_step_is_refused():
    env = make_env(physics="reference", control_timestep=0.045)
    with pytest.raises(ConfigError, match=r"control_timestep 0.045 s .*'fast'"):
        make_player(env, physics="fast")
