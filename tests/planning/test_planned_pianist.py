"""The planned pianist: it plays, in all the places where a trained model could."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from episodes import as_dict
from short_pieces import QUICK, both_hands, five_fingers, piano
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecMonitor, VecNormalize

from sb3_piano.exceptions import ConfigError
from sb3_piano.hands import find_hand
from sb3_piano.music import Note, Pedal, Score
from sb3_piano.music.fingering import without_fingers
from sb3_piano.players import planned as pianist
from sb3_piano.players.planned import PlannedPianist, Trackers
from sb3_piano.vec_env import ThreadVecEnv

WELL = 0.75  # F1; it plays far better, but how well is not a matter of these tests
PIECE = five_fingers()
OTHER = five_fingers(order=(4, 2, 0), length=0.3)
# Where it does not matter how well a piece is planned.
CARELESS = dataclasses.replace(QUICK, rounds=1, iterations=1, dynamic_iterations=1)


def play(env, player, *, pass_state=True, start=None):
    """Play an episode; return its final info and all actions."""
    observation, _ = env.reset() if start is None else (start, {})
    state, over, info, actions = None, False, {}, []
    while not over:
        began = np.array([not actions])
        action, following = player.predict(observation, state, episode_start=began)
        state = following if pass_state else None
        actions.append(action)
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    return info, np.array(actions)


@pytest.fixture(scope="module")
def solo():
    """An environment, its player, and how that plays: info, actions and keys."""
    env = piano(PIECE)
    player = PlannedPianist(env, QUICK)
    info, actions = play(env, player)
    return env, player, info, actions, env.unwrapped.performance.key_active


@pytest.mark.slow
def test_it_plays_a_piece_well_with_actions_of_the_space_and_resting_hands_do_not(solo):
    _, _, info, actions, _ = solo
    assert info["f1"] > WELL
    assert info["f1"] > info["noop_f1"] + 0.4
    assert actions.dtype == np.float32
    assert np.abs(actions).max() <= 1 + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"reduced_action_space": True, "physics": "reference"},
        {"reduced_action_space": True, "gravity_compensation": False},
        {"observation": "fingers", "n_steps_lookahead": 3},
        {"forearm_dofs": [*find_hand().forearm.joints.values()]},
        {},
    ],
    ids=str,
)
def test_it_plays_in_other_settings_too_and_without_fingers(options):
    score = both_hands(order=(0, 2))
    env = piano(score if options else without_fingers(score, keep_hands=False), **options)
    info, _ = play(env, PlannedPianist(env, QUICK))
    assert info["f1"] > WELL


def test_the_pedal_is_that_of_the_score():
    score = Score(notes=PIECE.notes, pedals=[Pedal(onset=0.2, offset=0.6)])
    env = piano(score)
    play(env, PlannedPianist(env, QUICK))
    np.testing.assert_array_equal(env.performance.sustain, env.roll.sustain)
    assert 0 < env.roll.sustain.sum() < len(env.roll)


def test_it_is_the_same_with_its_state_passed_on_and_without(solo):
    env, player, _, actions, _ = solo
    np.testing.assert_array_equal(play(env, player)[1], actions)
    np.testing.assert_array_equal(play(env, player, pass_state=False)[1], actions)


def test_a_new_episode_begins_at_the_beginning_whatever_the_state(solo):
    env, player, _, actions, _ = solo
    observation, _ = env.reset()
    late = np.array([9])
    action, state = player.predict(observation, late, episode_start=np.array([True]))
    np.testing.assert_array_equal(action, actions[0])
    assert state.tolist() == [1]
    assert late.tolist() == [9], "what is passed is not changed"
    action, state = player.predict(observation, late, episode_start=np.array([False]))
    assert state.tolist() == [10]
    assert np.abs(action - actions[0]).max() > 1e-3


def test_it_acts_by_what_it_observes_also_in_another_environment(solo):
    env, player, info, actions, _ = solo
    env.reset()
    other = piano(PIECE)
    elsewhere_info, elsewhere = play(other, player)
    np.testing.assert_array_equal(elsewhere, actions)
    assert elsewhere_info["f1"] == info["f1"]
    # Hands that are pushed aside are told something else, in the environment that is observed.
    observation, _ = other.reset()
    other.data.qpos[other.scene.slider_qpos] += 0.02
    pushed = other.set_state(other.get_state())
    assert np.abs(player.predict(pushed, np.array([0]))[0] - actions[0]).max() > 1e-3
    np.testing.assert_array_equal(player.predict(observation, np.array([0]))[0], actions[0])


def test_a_wrapper_may_hide_what_is_observed(solo):
    _, _, info, actions, _ = solo
    inner = piano(PIECE)
    box = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
    env = gym.wrappers.TransformObservation(inner, lambda o: np.zeros(3, np.float32), box)
    hidden_info, hidden = play(env, PlannedPianist(env, QUICK))
    np.testing.assert_allclose(hidden, actions, atol=1e-5)
    assert hidden_info["f1"] == pytest.approx(info["f1"], abs=0.05)


# Several environments, and what Stable-Baselines3 does with a model.


def play_all(venv, player):
    """Play an episode in all environments; return the keys that sounded in each."""
    observation, state = venv.reset(), None
    steps = max(len(env.unwrapped.roll) for env in venv.unwrapped.envs)
    over = np.zeros(venv.num_envs, dtype=bool)
    begun = np.ones(venv.num_envs, dtype=bool)
    keys = [[] for _ in range(venv.num_envs)]
    for _ in range(steps):
        actions, state = player.predict(observation, state, episode_start=begun)
        observation, _, begun, _ = venv.step(actions)
        for slot, env in enumerate(venv.unwrapped.envs):
            over[slot] |= begun[slot]
            if not over[slot]:
                keys[slot].append(env.unwrapped.key_active)
    return [np.array(one) for one in keys]


@pytest.mark.slow
@pytest.mark.parametrize("kind", [DummyVecEnv, ThreadVecEnv])
def test_each_of_several_environments_is_played_as_alone(solo, kind):
    _, _, _, _, alone = solo
    other = piano(OTHER)
    play(other, PlannedPianist(other, QUICK))
    venv = kind([lambda: piano(PIECE), lambda: piano(OTHER)])
    first, second = play_all(venv, PlannedPianist(venv, QUICK))
    venv.close()
    np.testing.assert_array_equal(first, alone[:-1])
    np.testing.assert_array_equal(second, other.performance.key_active[:-1])


@pytest.mark.parametrize("clip_obs", [10.0, 0.1])
def test_normalised_observations_give_the_same_music(solo, clip_obs):
    _, _, _, _, alone = solo
    venv = DummyVecEnv([lambda: piano(PIECE)])
    venv = VecNormalize(venv, norm_reward=False, clip_obs=clip_obs)
    venv = VecMonitor(venv)  # which changes no observation
    (keys,) = play_all(venv, PlannedPianist(venv, QUICK))
    assert (keys != alone[:-1]).mean() < 1e-3  # but for rounding
    assert keys.any()


def test_observations_may_be_a_dictionary(solo):
    env, player, _, actions, _ = solo
    for shown, several in ((as_dict(env), False), (as_dict(piano(PIECE)), True)):
        player = PlannedPianist(
            DummyVecEnv([lambda shown=shown: shown]) if several else shown, QUICK
        )
        found = player.predict(player.get_env().reset() if several else shown.reset()[0])[0]
        np.testing.assert_allclose(found[0] if several else found, actions[0], atol=1e-6)


def test_environments_in_other_processes_are_out_of_reach():
    venv = SubprocVecEnv([lambda: piano(PIECE)], start_method="fork")
    try:
        with pytest.raises(ConfigError, match=r"SubprocVecEnv.*expected DummyVecEnv or.*Thread"):
            PlannedPianist(venv)
    finally:
        venv.close()


def test_what_is_no_piano_is_refused():
    with pytest.raises(ConfigError, match="cannot be played: expected a piano"):
        PlannedPianist(gym.make("Pendulum-v1"))


def test_as_many_observations_as_environments_are_expected(solo):
    env, player, *_ = solo
    with pytest.raises(ConfigError, match="There are 2 observations: expected 1"):
        player.predict(np.zeros((2, *env.observation_space.shape)))


# Pieces that wrappers choose.


@pytest.mark.filterwarnings("ignore:.*cannot be played")
def test_the_plans_of_the_last_pieces_are_kept_and_of_all_that_play_at_once(monkeypatch):
    monkeypatch.setattr(pianist, "_PLANS_KEPT", 2)
    env, trackers = piano(OTHER), Trackers(CARELESS)
    for pitch in (60, 62, 64, 65):
        note = Note(onset=0, offset=0.1, pitch=pitch, finger=0)
        env.reset(options={"score": Score(notes=[note])})
        last = trackers.of(env)
    assert trackers.of(env) is last
    assert len(trackers._kept) == 2
    monkeypatch.setattr(pianist, "_PLANS_KEPT", 1)
    envs = [piano(five_fingers(length=length)) for length in (0.41, 0.43)]
    trackers = Trackers(CARELESS, n_envs=2)
    first = [trackers.of(env) for env in envs]
    assert [trackers.of(env) for env in envs] == first


@pytest.mark.filterwarnings("ignore:.*cannot be played")
def test_a_model_that_is_changed_between_episodes_has_another_plan():
    env, trackers = piano(five_fingers(length=0.42)), Trackers(CARELESS)
    env.reset()
    before = trackers.of(env)
    env.step(env.rest_action)
    env.model.actuator_gainprm[0, 0] *= 1.1
    assert trackers.of(env) is before  # to the end of the episode
    env.reset()
    assert trackers.of(env) is not before


@pytest.mark.filterwarnings("ignore:.*cannot be played")
def test_a_piece_is_planned_once_for_equal_scenes_and_anew_for_others(monkeypatch):
    made, plan = [], pianist.plan_piece
    monkeypatch.setattr(pianist, "plan_piece", lambda *given: made.append(given) or plan(*given))
    envs = [piano(five_fingers(length=0.35)) for _ in range(3)]
    envs[2].model.actuator_gainprm[0, 0] *= 1.1
    plans = [Trackers(CARELESS).of(env).plan for env in envs]
    assert plans[0] is plans[1]
    assert plans[2] is not plans[0]
    assert len(made) == 2
    Trackers(dataclasses.replace(CARELESS, rounds=2)).of(envs[0])
    assert len(made) == 3
    pianist.forget_plans()
    assert Trackers(CARELESS).of(envs[0]).plan is not plans[0]
    assert len(made) == 4


def test_it_sees_how_two_joints_share_the_way_of_their_actuator():
    env = piano(PIECE)
    observation, _ = env.reset(seed=0)
    player = PlannedPianist(env, QUICK)
    names = [name.rpartition("/")[2] for name in env.unwrapped.scene.joint_names[0]]
    joints = observation[env.observation_space.layout["right_joints"].slice]
    joints[[names.index("rh_RFJ2"), names.index("rh_RFJ1")]] = 0.5
    evenly, _ = player.predict(observation)
    joints[[names.index("rh_RFJ2"), names.index("rh_RFJ1")]] = 0.3, 0.7
    assert np.abs(player.predict(observation)[0] - evenly).max() > 0.01
