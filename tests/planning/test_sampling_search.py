"""The search of a control step rates what would really happen, and gives up nothing that wins."""

import dataclasses

import numpy as np
import pytest
from sampling_parts import TUNE, UNLABELLED, WEAK, make_env, make_player, make_search, play

from sb3_piano.music import Score
from sb3_piano.planning.sampling import SamplingCost, SamplingNoise
from sb3_piano.planning.sampling.noise import Candidates
from sb3_piano.planning.sampling.search import CandidateSearch, Simulations
from sb3_piano.players.planned import PlannedPianist, Trackers


def positions_in(env, tracker):
    return tracker.positions(env.data.qpos[env.scene.hand_qpos])


def cost_by_hand(env, change, tracker, cost, deviation):
    """Play a candidate in an environment and add up what it costs, key by key."""
    total = 0.0
    for ahead, delta in enumerate(change):
        step = env.steps_played
        if step == len(env.roll):
            break
        low, high = env.scene.ctrl_low, env.scene.ctrl_high
        told = delta + (
            np.clip(0.0, low, high)
            if tracker is None
            else tracker.controls(step, positions_in(env, tracker))
        )
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
        if tracker is None:
            tips = env.scene.fingertip_position(env.data)
            for key, finger in zip(*env.roll.due(step), strict=True):
                point = env.scene.press_point(env.data, np.array([key]))[0]
                gap = np.linalg.norm(tips[finger] - point)
                now += cost.distance * (1 - cost.reach / (cost.reach + gap))
        else:
            planned = tracker.plan.positions[step + 1]
            gaps = np.abs(positions_in(env, tracker) - planned) / (cost.tolerance * deviation)
            now += cost.astray * np.mean([min(gap, 1) ** 2 for gap in gaps])
        total += cost.discount**ahead * now
    return total


@pytest.mark.slow
@pytest.mark.parametrize("around_a_plan", [False, True])
@pytest.mark.parametrize(
    ("played_in", "simulated_in"),
    [("fast", None), ("reference", None), ("reference", "fast"), ("fast", "reference")],
)
def test_a_candidate_costs_what_an_environment_that_plays_it_counts(
    played_in, simulated_in, around_a_plan
):
    env = make_env(physics=played_in)
    tracker = Trackers(WEAK).of(env) if around_a_plan else None
    candidates, search = make_search(env, simulated_in, horizon=5, tracker=tracker)
    knots = candidates.draw(3, np.random.default_rng(1))
    play(env, make_player(env), 3)  # the rating reaches into the notes
    ratings = search.rate(env, knots)
    for n, change in enumerate(candidates.over_horizon(knots)):
        other = make_env(physics=simulated_in or played_in)
        # A state belongs to its physics; here the same numbers are to go on in others.
        other.set_state(dataclasses.replace(env.get_state(), simulation=""))
        expected = cost_by_hand(other, change, tracker, SamplingCost(), candidates.deviation)
        assert expected > 0.1
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


def test_giving_up_candidates_loses_none_that_would_have_won():
    env = make_env()
    play(env, make_player(env), 3)
    candidates, search = make_search(env, n=12)
    knots = candidates.draw(12, np.random.default_rng(2))
    everything = search.rate(env, knots)
    for n_known in (1, 5):
        best, controls = search.best(env, knots[:n_known], knots[n_known:])
        winner = int(np.argmin(everything.cost))
        np.testing.assert_array_equal(best, knots[winner])
        np.testing.assert_array_equal(controls, everything.controls[winner])


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
    search = CandidateSearch(env.roll, simulations, None, candidates, SamplingCost(effort=1))
    nothing = candidates.none()
    hopeless = candidates.draw(4, np.random.default_rng(0)) * 100
    search.best(env, np.stack([nothing, hopeless[0]]), hopeless[1:])
    assert simulations.steps == 2 * 5 + 3


@pytest.mark.slow
def test_around_a_plan_nothing_is_tried_until_something_would_sound_wrong():
    env = make_env(initial_buffer_time=0.3)
    tracker = Trackers(WEAK).of(env)
    noise = SamplingNoise()
    candidates = Candidates(noise, env.scene, 4)
    nothing = candidates.none()[None]
    tried = []
    for _ in range(6):
        simulations = Counting(env, None, 3, 1)
        search = CandidateSearch(env.roll, simulations, tracker, candidates, SamplingCost())
        new = candidates.draw(3, np.random.default_rng(0))
        best, controls = search.best(env, nothing, new)
        tried.append(simulations.steps > 4)
        if not tried[-1]:
            np.testing.assert_array_equal(best, nothing[0])
            np.testing.assert_array_equal(
                controls, tracker.controls(env.steps_played, positions_in(env, tracker))
            )
        play(env, PlannedPianist(env, WEAK), 1)
    # The first note is due in step 6, and this plan does not press it down.
    assert tried == [False, False, False, True, True, True]


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
    parts = (None, candidates, SamplingCost())
    simulations = Unstable(env, physics, 3, 1)
    cost = CandidateSearch(env.roll, simulations, *parts).rate(env, knots).cost
    assert cost[0] == np.inf
    assert np.isfinite(cost[1:]).all()
    simulations.__class__ = Simulations
    again = CandidateSearch(env.roll, simulations, *parts).rate(env, knots).cost
    np.testing.assert_array_equal(again[1:], cost[1:])
    assert np.isfinite(again[0])
