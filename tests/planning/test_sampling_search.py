"""The search of a control step rates what would really happen, and gives up nothing that wins."""

import dataclasses
import itertools

import numpy as np
import pytest
from sampling_parts import TUNE, UNLABELLED, WEAK, make_env, make_player, make_search, play
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Score
from sb3_piano.planning import sampling
from sb3_piano.planning.sampling.cost import SamplingCost, wrong_keys
from sb3_piano.planning.sampling.noise import Candidates, SamplingNoise
from sb3_piano.planning.sampling.search import CandidateSearch, simulations_of
from sb3_piano.players.planned import PlannedPianist, Trackers
from sb3_piano.simulation import compile_scene
from sb3_piano.simulation.simulations import Simulations


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

    def advance(self, which, controls, **options):
        self.steps += len(which)
        return super().advance(which, controls, **options)


def test_hopeless_candidates_are_not_simulated_to_the_end():
    env = make_env()
    candidates, _ = make_search(env, horizon=5)
    simulations = Counting(env.scene, env.config.n_substeps, 4, 1)
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
        simulations = Counting(env.scene, env.config.n_substeps, 3, 1)
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

    def begin(self, state, count):
        super().begin(state, count)
        self._batch.bind("qvel")[0] = 1e12


@pytest.mark.parametrize("physics", [None, "reference"])
def test_unstable_candidates_never_win_and_leave_no_trace(physics):
    env = make_env()
    candidates, _ = make_search(env)
    knots = candidates.draw(3, np.random.default_rng(2))
    parts = (None, candidates, SamplingCost())
    simulations = simulations_of(env, physics, 3, 1)
    simulations.__class__ = Unstable
    cost = CandidateSearch(env.roll, simulations, *parts).rate(env, knots).cost
    assert cost[0] == np.inf
    assert np.isfinite(cost[1:]).all()
    simulations.__class__ = Simulations
    again = CandidateSearch(env.roll, simulations, *parts).rate(env, knots).cost
    np.testing.assert_array_equal(again[1:], cost[1:])
    assert np.isfinite(again[0])


# What candidates cost where it does not follow from a simulation.


NOTHING = {
    "missed": 0, "wrong": 0, "reluctant": 0, "brushed": 0, "astray": 0, "distance": 0, "effort": 0
}  # fmt: skip
SOUNDING = np.full(88, 0.1)


def only(**weights):
    return SamplingCost(**{**NOTHING, **weights})


def keys(**angles):
    """Return angles of one candidate's keys, given as k40=0.1."""
    row = np.zeros((1, 88))
    for name, angle in angles.items():
        row[0, int(name[1:])] = angle
    return row


def due(*which):
    return np.isin(np.arange(88), which)


def test_keys_that_cannot_sound_are_never_wrong():
    sounding = np.where(np.arange(88) == 41, np.inf, SOUNDING)
    angles = keys(k41=0.0)
    assert not SamplingCost().key_cost(due(), angles, sounding).any()
    cost = only(missed=1, reluctant=1).key_cost(due(41), angles, sounding)
    assert cost.sum(axis=1) == pytest.approx([2.0])


def test_actuators_without_noise_are_not_counted():
    deviation = np.array([0.1, 0.0])
    apart = np.array([[0.1, 0.7]])
    assert only(effort=2).effort_cost(apart, deviation) == pytest.approx([2])
    planned = only(astray=3, tolerance=1).plan_cost(np.zeros(2), apart, deviation)
    assert planned == pytest.approx([3])
    assert only(effort=2).effort_cost(apart, np.zeros(2)) == pytest.approx([0])


def test_any_fingers_cost_the_least_of_all_assignments():
    random = np.random.default_rng(3)
    tips, points = random.uniform(0, 0.1, (4, 10, 3)), random.uniform(0, 0.1, (4, 3, 3))
    cost = only(distance=1.5, reach=0.06)

    def far(offset):
        return 1 / (1 + 0.06 / np.linalg.norm(offset))

    expected = [
        min(
            1.5 * sum(far(t[f] - p) for f, p in zip(chosen, q, strict=True))
            for chosen in itertools.permutations(range(10), 3)
        )
        for t, q in zip(tips, points, strict=True)
    ]
    assert cost.any_finger_cost(tips, points) == pytest.approx(expected)


@Tables(__file__)("settings, name, value")
def test_settings_out_of_range_are_named(settings, name, value):
    with pytest.raises(ConfigError, match=f"{name} is {value!r}: expected a "):
        getattr(sampling, settings)(**{name: value})


def test_mistakes_are_keys_that_sound_undue_or_are_silent_though_due():
    candidates = np.concatenate([keys(), keys(k40=0.1, k44=0.2), keys(k40=0.2, k41=0.1, k7=0.09)])
    assert wrong_keys(due(40, 44), candidates, SOUNDING).tolist() == [2, 0, 2]


# Random changes: how large, where, and how they go on.


SCENE = compile_scene(physics="fast")
NU = SCENE.model.nu
NAMES = [SCENE.model.actuator(a).name.rsplit("/")[-1] for a in range(NU)]
WRISTS = [a for a, name in enumerate(NAMES) if "WRJ" in name]
FOREARMS = [a for a, name in enumerate(NAMES) if name.startswith("forearm")]
FINGERS = [a for a in range(NU) if a not in WRISTS + FOREARMS]


def candidates(horizon=6, **noise):
    return Candidates(SamplingNoise(**noise), SCENE, horizon)


def test_each_kind_of_actuator_has_its_own_noise():
    drawn = candidates(share=1, finger=0.2, wrist=0.05, forearm=0.01).draw(
        3000, np.random.default_rng(0)
    )
    assert len(WRISTS) == len(FOREARMS) == 4
    for actuators, expected in ((FINGERS, 0.2), (WRISTS, 0.05), (FOREARMS, 0.01)):
        np.testing.assert_allclose(drawn[:, :, actuators].std(axis=0), expected, rtol=0.08)
    np.testing.assert_allclose(drawn.mean(axis=0), 0, atol=0.02)


def test_only_a_share_of_the_actuators_is_changed_and_those_at_all_knots():
    drawn = candidates(share=0.3, knots=3).draw(2000, np.random.default_rng(0))
    changed = drawn != 0
    assert (changed.all(axis=1) == changed.any(axis=1)).all()
    np.testing.assert_allclose(changed.mean(axis=(0, 1)), 0.3, atol=0.05)


def test_changes_are_straight_lines_between_knots():
    knots = np.zeros((1, 3, NU))
    knots[0, :, 5] = [1.0, 2.0, -1.0]
    change = candidates(horizon=5, knots=3).over_horizon(knots)
    assert change.shape == (1, 5, NU)
    np.testing.assert_allclose(change[0, :, 5], [1.0, 1.5, 2.0, 0.5, -1.0])
    assert not change[0, :, :5].any()


@pytest.mark.parametrize(("knots", "horizon"), [(1, 4), (2, 1), (3, 1)])
def test_a_single_knot_is_a_constant_change(knots, horizon):
    drawing = candidates(horizon=horizon, knots=knots)
    drawn = drawing.draw(2, np.random.default_rng(0))
    assert drawn.shape == (2, 1, NU)
    expected = np.repeat(drawn, horizon, axis=1)
    np.testing.assert_array_equal(drawing.over_horizon(drawn), expected)


@pytest.mark.parametrize(
    ("horizon", "n_knots", "decay", "kept"),
    [(4, 9, 1.0, [1, 2, 3, 3]), (5, 2, 0.5, [1, 4])],
    ids=["at each step", "few knots"],
)
def test_a_step_later_a_change_goes_on_where_it_was_and_holds_at_its_end(
    horizon, n_knots, decay, kept
):
    drawing = candidates(horizon=horizon, knots=n_knots, decay=decay)
    assert drawing.none().shape == (min(horizon, n_knots), NU)
    knots = drawing.draw(1, np.random.default_rng(0))[0]
    before = drawing.over_horizon(knots[None])[0]
    np.testing.assert_allclose(drawing.shifted(knots), decay * before[kept])
