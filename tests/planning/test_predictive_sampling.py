"""Predictive sampling: it rates what would really happen, and disturbs nothing."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, EnvStateError
from sb3_piano.music import Note, Pedal, Score
from sb3_piano.planning import PlannedPianist, PlanSettings, Trackers
from sb3_piano.planning.sampling import (
    NOISE_FROM_ZERO,
    PredictiveSampling,
    SamplingCost,
    SamplingNoise,
)
from sb3_piano.planning.sampling.candidates import Candidates
from sb3_piano.planning.sampling.nominal import Rest, Tracked
from sb3_piano.planning.sampling.search import Search
from sb3_piano.planning.sampling.simulations import Simulations

# Keys near where the hands begin.
TUNE = Score(
    notes=[
        Note(onset=0.0, offset=0.2, pitch=76, finger=1),
        Note(onset=0.0, offset=0.2, pitch=48, finger=7),
        Note(onset=0.25, offset=0.45, pitch=77, finger=2),
    ],
    pedals=[Pedal(onset=0.1, offset=0.3)],
)
UNLABELLED = Score(notes=[Note(onset=n.onset, offset=n.offset, pitch=n.pitch) for n in TUNE.notes])
HELD = [
    Note(onset=0.0, offset=0.9, pitch=76, finger=1),
    Note(onset=0.0, offset=0.9, pitch=48, finger=7),
]


def make_env(score=TUNE, **options):
    env = PianoEnv(score, **{"physics": "fast", **options})
    env.reset(seed=0)
    return env


def make_player(env, **options):
    return PredictiveSampling(
        env, **{"nominal": "none", "samples": 8, "horizon": 3, "n_threads": 1, **options}
    )


def play(env, player, n_steps):
    """Return the actions of some steps."""
    observation, actions = np.zeros(env.observation_space.shape), []
    for _ in range(n_steps):
        actions.append(player.predict(observation)[0])
        observation = env.step(actions[-1])[0]
    return np.array(actions)


def play_episode(env, player):
    """Return the final info of an episode."""
    observation, _ = env.reset()
    state, over, info = None, False, {}
    while not over:
        action, state = player.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    return info


def make_search(env, physics=None, noise=NOISE_FROM_ZERO, horizon=4, n=3, nominal=None, **cost):
    candidates = Candidates(noise, env.scene, horizon)
    simulations = Simulations(env, physics, n, 1)
    nominal = Rest(env.scene) if nominal is None else nominal
    return candidates, Search(env.roll, simulations, nominal, candidates, SamplingCost(**cost))


# The rating, against an environment that really plays the candidate.


class Pulled:
    """Nominal controls that depend on where the actuators are, towards a plan of its own."""

    def controls(self, step, positions):
        return 0.5 * positions + 0.05 * np.sin(step + np.arange(positions.shape[1]))

    def planned(self, step):
        return None


class Planned(Pulled):
    def planned(self, step):
        return 0.1 * np.cos(step + np.arange(38))


def cost_by_hand(env, change, nominal, cost, deviation):
    """Play a candidate in an environment and add up what it costs, key by key."""
    total = 0.0
    for ahead, delta in enumerate(change):
        step = env.steps_played
        if step == len(env.roll):
            break
        low, high = env.scene.ctrl_low, env.scene.ctrl_high
        told = nominal.controls(step, env.data.actuator_length[None])[0] + delta
        env.step(np.append(2 * (np.clip(told, low, high) - low) / (high - low) - 1, -1))
        now = 0.0
        angle, needed = env.scene.key_angle(env.data), env.scene.key_sounding_angle
        for key in range(88):
            way = min(angle[key] / needed[key], 1)
            if env.roll.active[step, key]:
                now += cost.missed * (not env.key_active[key]) + cost.reluctant * (1 - way)
            else:
                now += cost.wrong * env.key_active[key] + cost.brushed * way**2
        now += cost.effort * np.mean((delta / deviation) ** 2)
        plan = nominal.planned(step)
        if plan is None:
            tips = env.scene.fingertip_position(env.data)
            for key, finger in zip(*env.roll.due(step), strict=True):
                point = env.scene.press_point(env.data, np.array([key]))[0]
                gap = np.linalg.norm(tips[finger] - point)
                now += cost.distance * (1 - cost.reach / (cost.reach + gap))
        else:
            gaps = np.abs(env.data.actuator_length - plan) / (cost.tolerance * deviation)
            now += cost.astray * np.mean([min(gap, 1) ** 2 for gap in gaps])
        total += cost.discount**ahead * now
    return total


@pytest.mark.parametrize("nominal", [Rest, Pulled, Planned])
@pytest.mark.parametrize(
    ("played_in", "simulated_in"),
    [("fast", None), ("reference", None), ("reference", "fast"), ("fast", "reference")],
)
def test_a_candidate_costs_what_an_environment_that_plays_it_counts(
    played_in, simulated_in, nominal
):
    env = make_env(physics=played_in)
    nominal = Rest(env.scene) if nominal is Rest else nominal()
    candidates, search = make_search(env, simulated_in, horizon=5, nominal=nominal)
    knots = candidates.draw(3, np.random.default_rng(1))
    play(env, make_player(env), 3)  # the rating reaches into the notes
    ratings = search.rate(env, knots)
    for n, change in enumerate(candidates.over_horizon(knots)):
        other = make_env(physics=simulated_in or played_in)
        other.set_state(env.get_state())
        expected = cost_by_hand(other, change, nominal, SamplingCost(), candidates.deviation)
        assert expected > 0.5
        assert ratings.cost[n] == pytest.approx(expected, rel=1e-6)


def test_in_a_piece_with_labels_notes_without_draw_no_finger():
    later = [dataclasses.replace(n, onset=n.onset + 0.5, offset=n.offset + 0.5) for n in TUNE.notes]
    ratings = {}
    for name, notes in {"some": UNLABELLED.notes, "all": TUNE.notes}.items():
        env = make_env(Score(notes=[*notes, *later]))
        for distance in (0, 1):
            _, search = make_search(env, distance=distance)
            knots = np.zeros((1, 3, env.model.nu))
            ratings[name, distance] = search.rate(env, knots).cost[0]
    assert ratings["some", 0] == ratings["some", 1] == ratings["all", 0] < ratings["all", 1]


def test_a_rating_stops_at_the_end_of_the_piece():
    env = make_env()
    play(env, make_player(env), len(env.roll) - 2)
    knots = np.zeros((1, 1, env.model.nu))
    noise = SamplingNoise(knots=1)
    long, short = (make_search(env, noise=noise, horizon=h)[1].rate(env, knots) for h in (9, 2))
    np.testing.assert_array_equal(long.cost, short.cost)


def test_giving_up_candidates_loses_none_that_would_have_won():
    env = make_env()
    play(env, make_player(env), 3)
    candidates, search = make_search(env, n=12)
    knots = candidates.draw(12, np.random.default_rng(2))
    everything = search.rate(env, knots)
    for n_known in (1, 5):
        best = search.best(env, knots[:n_known], knots[n_known:])
        winner = int(np.argmin(everything.cost))
        assert best.cost == everything.cost[winner]
        np.testing.assert_array_equal(best.knots, knots[winner])
        np.testing.assert_array_equal(best.controls, everything.controls[winner])


def test_only_candidates_beyond_the_bound_are_given_up():
    env = make_env()
    candidates, search = make_search(env, n=6)
    knots = candidates.draw(6, np.random.default_rng(2))
    free = search.rate(env, knots).cost
    bound = float(np.median(free))
    expected = np.where(free > bound, np.inf, free)
    np.testing.assert_array_equal(search.rate(env, knots, bound=bound).cost, expected)


class Counting(Simulations):
    """Counts the control steps of all simulations."""

    steps = 0

    def advance(self, which, controls):
        self.steps += len(which)
        return super().advance(which, controls)


def test_hopeless_candidates_are_not_simulated_to_the_end():
    env = make_env()
    candidates, _ = make_search(env, horizon=5)
    simulations = Counting(env, None, 4, 1)
    search = Search(env.roll, simulations, Rest(env.scene), candidates, SamplingCost(effort=1))
    nothing = candidates.none()
    hopeless = candidates.draw(4, np.random.default_rng(0)) * 100
    search.best(env, np.stack([nothing, hopeless[0]]), hopeless[1:])
    assert simulations.steps == 2 * 5 + 3


class Unstable(Simulations):
    """The first simulation begins with speeds at which physics ends."""

    def begin(self, piano, n):
        super().begin(piano, n)
        self._datas[0].qvel[:] = 1e12


@pytest.mark.parametrize("physics", [None, "reference"])
def test_unstable_candidates_never_win_and_leave_no_trace(physics):
    env = make_env()
    candidates, _ = make_search(env)
    knots = candidates.draw(3, np.random.default_rng(2))
    parts = (Rest(env.scene), candidates, SamplingCost())
    simulations = Unstable(env, physics, 3, 1)
    cost = Search(env.roll, simulations, *parts).rate(env, knots).cost
    assert cost[0] == np.inf
    assert np.isfinite(cost[1:]).all()
    simulations.__class__ = Simulations
    again = Search(env.roll, simulations, *parts).rate(env, knots).cost
    np.testing.assert_array_equal(again[1:], cost[1:])
    assert np.isfinite(again[0])


# The player.


def test_actions_are_those_of_the_action_space_however_wild_the_noise():
    env = make_env()
    wild = SamplingNoise(finger=9, wrist=9, forearm=1)
    for action in play(env, make_player(env, noise=wild, cost=SamplingCost(effort=0)), 4):
        assert env.action_space.contains(action)


def test_equal_seeds_play_alike_and_others_do_not():
    played = [play(e := make_env(), make_player(e, seed=seed), 4) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(played[0], played[1])
    assert np.abs(played[0] - played[2]).max() > 0.01


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


@pytest.mark.parametrize("labelled", [True, False])
def test_from_zero_it_plays_more_than_resting_hands_do(labelled):
    fingers = [note.finger if labelled else -1 for note in HELD]
    notes = [dataclasses.replace(n, finger=f) for n, f in zip(HELD, fingers, strict=True)]
    env = make_env(Score(notes=notes), initial_buffer_time=0.3)
    resting = play_episode(env, make_player(env, samples=1))["f1"]
    sampled = play_episode(env, make_player(env, samples=20, horizon=5))["f1"]
    assert sampled > resting + 0.2


def test_a_single_candidate_without_a_plan_is_hands_at_rest():
    env = make_env()
    actions = play(env, make_player(env, samples=1), 5)
    np.testing.assert_allclose(actions[:, :-1], np.tile(env.rest_action[:-1], (5, 1)), atol=1e-6)


# A plan that is made fast, and presses no key down.
WEAK = PlanSettings(
    rounds=2, iterations=4, hold_depth=0.6, press_force=0, press_force_thumb=0, feedback=0.1
)


def test_a_single_candidate_with_a_plan_is_the_planned_pianist():
    env = make_env(initial_buffer_time=0.3)
    player = make_player(env, nominal="plan", plan_settings=WEAK, samples=1, horizon=1)
    sampled = play(env, player, 8)
    env.reset()
    planned = play(env, PlannedPianist(env, WEAK), 8)
    np.testing.assert_allclose(sampled, planned, atol=1e-6)


def test_a_plan_tells_where_the_actuators_are_at_the_end_of_a_step():
    env = make_env(initial_buffer_time=0.3)
    nominal = Tracked(Trackers(WEAK).of(env))
    player = make_player(env, nominal="plan", plan_settings=WEAK, samples=1, horizon=1)
    away = {-1: 0.0, 0: 0.0, 1: 0.0}
    for step in range(6):
        if step > 1:  # on the way
            for shift in away:
                apart = env.data.actuator_length - nominal.planned(step - 1 + shift)
                away[shift] += np.abs(apart).sum()
        play(env, player, 1)
    assert away[0] < 0.5 * min(away[-1], away[1])


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


def test_a_new_episode_begins_with_no_change():
    env = make_env()
    player = make_player(env, samples=6)
    play(env, player, 5)
    env.reset()
    fresh = make_player(env, samples=6)
    fresh._random = copy.deepcopy(player._random)
    observation = np.zeros(env.observation_space.shape)
    np.testing.assert_array_equal(player.predict(observation)[0], fresh.predict(observation)[0])


def test_another_score_is_rated_by_its_own_keys():
    env, other = make_env(), make_env(Score(notes=HELD))
    player = make_player(env)
    play(env, player, 3)
    play(other, make_player(other), 3)
    env.set_state(other.get_state())  # the same control step, but in another piece
    fresh = make_player(env)
    fresh._random = copy.deepcopy(player._random)
    observation = np.zeros(env.observation_space.shape)
    np.testing.assert_array_equal(player.predict(observation)[0], fresh.predict(observation)[0])


def test_a_change_is_gone_when_the_episode_went_elsewhere():
    env = make_env()
    player = make_player(env, samples=6)
    play(env, player, 2)
    state = env.get_state()
    play(env, player, 3)
    env.set_state(state)
    fresh = make_player(env, samples=6)
    fresh._random = copy.deepcopy(player._random)
    observation = np.zeros(env.observation_space.shape)
    np.testing.assert_array_equal(player.predict(observation)[0], fresh.predict(observation)[0])


@pytest.mark.parametrize("physics", [None, "reference"])
def test_keys_may_become_rigid(physics):
    env = make_env()
    player = make_player(env, physics=physics)
    play(env, player, 2)
    env.fix_keys(20, 70)
    env.reset()
    fresh = make_player(env, physics=physics)
    fresh._random = copy.deepcopy(player._random)
    state = env.get_state()
    actions = play(env, player, 3)
    env.set_state(state)
    np.testing.assert_array_equal(actions, play(env, fresh, 3))


def test_changes_to_the_model_are_simulated():
    played = []
    for stiffness in (1.0, 30.0):
        env = make_env()
        env.model.actuator_gainprm[:] *= stiffness
        played.append(make_search(env)[1].rate(env, np.ones((1, 3, env.model.nu))).cost)
    assert played[0] != pytest.approx(played[1], rel=1e-3)


def test_each_of_several_environments_is_played_as_alone():
    scores = (TUNE, UNLABELLED)
    vec = DummyVecEnv([lambda s=s: make_env(s) for s in scores])
    observations, player = vec.reset(), make_player(vec)
    state = None
    played = []
    for _ in range(3):
        actions, state = player.predict(observations, state)
        played.append(actions)
        observations = vec.step(actions)[0]
    alone = make_env()
    np.testing.assert_array_equal(np.array(played)[:, 0], play(alone, make_player(alone), 3))
    assert np.abs(played[-1][0] - played[-1][1]).max() > 0.01


def test_equal_environments_get_candidates_of_their_own():
    vec = DummyVecEnv([make_env, make_env])
    vec.reset()
    actions, _ = make_player(vec, samples=20).predict(np.zeros((2, *vec.observation_space.shape)))
    assert np.abs(actions[0] - actions[1]).max() > 0.01


def test_evaluate_policy_takes_it_over_several_episodes():
    vec = DummyVecEnv([make_env] * 2)
    player = make_player(vec, samples=1, horizon=1)
    returns, lengths = evaluate_policy(
        player, vec, n_eval_episodes=4, return_episode_rewards=True, warn=False
    )
    assert lengths == [len(make_env().roll)] * 4
    assert len(returns) == 4


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


@pytest.mark.parametrize(
    ("argument", "value", "message"),
    [
        ("nominal", "plans", "nominal is 'plans': expected one of 'plan', 'none'.*'plan'"),
        ("samples", 0, "samples is 0: expected a whole number from 1 on"),
        ("samples", 2.0, "samples is 2.0"),
        ("horizon", 0, "horizon is 0: expected a whole number from 1 on"),
        ("seed", -1, "seed is -1: expected a whole number from 0 on"),
        ("physics", "quick", "Unknown physics profile 'quick'"),
        ("n_threads", 0, "n_threads is 0: expected a whole number from 1 on"),
    ],
)
def test_wrong_arguments_are_named(argument, value, message):
    with pytest.raises(ConfigError, match=message):
        make_player(make_env(), **{argument: value})


def test_a_physics_profile_that_does_not_fit_the_control_step_is_refused():
    env = make_env(physics="reference", control_timestep=0.045)
    with pytest.raises(ConfigError, match=r"control_timestep 0.045 s .*'fast'"):
        make_player(env, physics="fast")
