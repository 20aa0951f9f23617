"""Reward terms: the cases that recorded episodes do not have, and dm_control's tolerance."""

import numpy as np
import pytest

from sb3_piano.envs import PianoEnv, rewards
from sb3_piano.metrics import Onsets, match_onsets
from sb3_piano.metrics.onsets import OpenOnsets
from sb3_piano.music import Note, PianoRoll, Score, load_score
from sb3_piano.music.dynamics import velocity_of
from sb3_piano.players import make_player
from sb3_piano.wrappers import HandReward


def test_tolerance_equals_dm_controls():
    dm_tolerance = pytest.importorskip("dm_control.utils.rewards").tolerance
    x = np.linspace(-2, 3, 101)
    expected = dm_tolerance(x, bounds=(0, 0.05), margin=0.5, sigmoid="gaussian")
    ours = [rewards.tolerance(distance, 0.05, 0.5) for distance in x.tolist()]
    np.testing.assert_allclose(ours, expected, rtol=1e-12)


def test_optimal_transport_takes_the_cheapest_assignment_not_the_first():
    tips = np.full((10, 3), 5.0)
    tips[7], tips[2] = [0, 0, 0], [0, 0.3, 0]
    press = np.array([[0, 0.3, 0], [0, 0, 0]])
    assert rewards.optimal_transport_fingering(tips, press) == 1.0
    many = np.zeros((12, 3))  # of more keys than fingers the ten nearest count
    many[10:] = 9.0
    assert rewards.optimal_transport_fingering(np.zeros((10, 3)), many) == 1.0


def test_fingering_terms_where_nothing_is_due():
    nothing = np.zeros((0, 3))
    assert rewards.labelled_fingering([]) == 0.0
    assert rewards.optimal_transport_fingering(np.zeros((10, 3)), nothing) == 1.0


def played(env, actions, steps=None):
    """Play to the end, or some steps; return the strike terms, the rewards and the last info."""
    _, rewards, _, _, infos = zip(*map(env.step, actions[:steps]), strict=True)
    return [info["reward_terms"]["strike"] for info in infos], list(rewards), infos[-1]


# The reward term of strikes.


@pytest.fixture(scope="module")
def twinkle():
    """Six seconds of a piece, and actions that play it well but for some wild ones."""
    options = {"reduced_action_space": False, "initial_buffer_time": 0.5, "physics": "fast"}
    score = load_score("TwinkleTwinkle").excerpt(0, 6)
    env = PianoEnv(score, fingering="robot", reward_weights={"strike": 0.5}, **options)
    player = make_player("sight-reader", env)
    observation, _ = env.reset(seed=0)
    actions, state, random = [], None, np.random.default_rng(0)
    for step in range(len(env.roll)):
        action, state = player.predict(observation, state)
        if step % 25 > 19:
            action = random.uniform(-1, 1, action.shape)
        actions.append(action)
        observation = env.step(action)[0]
    return env, actions


def test_an_episode_sums_up_to_hits_less_the_other_strikes(twinkle):
    env, actions = twinkle
    env.reset(seed=0)
    terms, _, info = played(env, actions)
    performance, roll = env.performance, env.roll
    target = Onsets(roll.onset_time, np.nonzero(roll.onset)[1])
    strikes = Onsets(performance.strike_time, performance.presses.key)
    hits = len(match_onsets(target, strikes))
    assert 5 < hits < len(strikes.key)
    assert sum(terms) == 2 * hits - len(strikes.key)
    assert info["return_strike"] == 0.5 * sum(terms)
    assert max(terms) > 0 > min(terms)


def test_the_hands_share_the_pay_for_loudness(twinkle):
    env, actions = twinkle
    earned = []
    for dynamics in (0.0, 1.0):
        hands = HandReward(env, dynamics=dynamics)
        hands.reset(seed=0)
        infos = [hands.step(action)[-1] for action in actions[:60]]
        earned.append(sum(info["hand_rewards"].sum() for info in infos))
    paid = sum(info["reward_terms"]["dynamics"] for info in infos)
    assert earned[1] - earned[0] == pytest.approx(paid)
    assert paid > 0


def test_strikes_in_time_pay_by_how_near_their_loudness_is_to_the_notes(twinkle):
    env, actions = twinkle
    env.reset(seed=0)
    paid = [env.step(action)[-1]["reward_terms"]["dynamics"] for action in actions]
    performance, roll = env.performance, env.roll
    target = Onsets(roll.onset_time, np.nonzero(roll.onset)[1])
    strikes = Onsets(performance.strike_time, performance.presses.key)
    pairs = np.asarray(match_onsets(target, strikes))
    due = roll.onset_velocity[pairs[:, 0]]
    keys = performance.presses.key[pairs[:, 1]]
    struck = list(map(velocity_of, performance.strike_speed[pairs[:, 1]], keys))
    worth = np.maximum(1 - np.abs(np.subtract(due, struck, dtype=float)) / 30, 0)
    assert 0 < worth.sum() < len(pairs)
    assert sum(paid) == pytest.approx(worth.sum())


def test_a_restored_state_knows_what_was_struck(twinkle):
    env, actions = twinkle
    env.reset(seed=0)
    played(env, actions, 60)
    state, still_open = env.get_state(), env._record._open.copy()
    once = played(env, actions[60:])
    env.reset(seed=0)
    env.set_state(state)
    assert env._record._open._times == still_open._times != OpenOnsets(env.roll)._times
    again = played(env, actions[60:])
    assert once[:2] == again[:2]
    assert once[2]["return_strike"] == again[2]["return_strike"]


def test_without_a_weight_it_is_told_and_earns_nothing(twinkle):
    weighted, actions = twinkle
    options = {"reduced_action_space": False, "initial_buffer_time": 0.5, "physics": "fast"}
    plain = PianoEnv(weighted.default_score, fingering="robot", **options)
    for env in (weighted, plain):
        env.reset(seed=0)
    terms, rewards, info = played(weighted, actions)
    plain_terms, plain_rewards, plain_info = played(plain, actions)
    assert terms == plain_terms
    differences = np.subtract(rewards, plain_rewards)
    np.testing.assert_allclose(differences, 0.5 * np.array(terms), atol=1e-12)
    assert plain_info["return_strike"] == 0
    onsets = np.count_nonzero(plain.roll.onset)
    share, plain_share = (one["normalized_return"] for one in (info, plain_info))
    highest = sum(plain_rewards) / plain_share
    assert share == pytest.approx(sum(rewards) / (highest + 0.5 * onsets))


class TestOpenOnsets:
    def roll(self):
        notes = [Note(onset=time, offset=time + 0.1, pitch=60) for time in (0.2, 0.5)]
        return PianoRoll.from_score(Score(notes=notes, title="repeated"), 0.05)

    @pytest.mark.parametrize(
        ("strikes", "hits"),
        [
            ([0.15, 0.55], [True, True]),  # 50 ms early and late
            ([0.149, 0.551], [False, False]),
            ([0.2, 0.21], [True, False]),  # a note is hit once
        ],
    )
    def test_a_strike_hits_an_open_note_within_the_tolerance(self, strikes, hits):
        onsets = OpenOnsets(self.roll())
        assert [onsets.hit(39, time) for time in strikes] == hits

    def test_at_the_edge_of_the_tolerance_it_agrees_with_the_metric(self):
        notes, key, hits = [Note(onset=0.48297, offset=0.9, pitch=60)], np.array([39]), []
        roll = PianoRoll.from_score(Score(notes=notes, title="one"), 0.05)
        ((_, _, onset),) = roll.strikes()
        for distance in np.arange(499, 502, 0.1) / 10_000:
            for time in (onset - distance, onset + distance):
                pairs = match_onsets(Onsets(np.array([onset]), key), Onsets(np.array([time]), key))
                hits.append(OpenOnsets(roll).hit(39, time))
                assert hits[-1] == (len(pairs) == 1), distance
        assert set(hits) == {True, False}

    def test_another_key_is_never_hit(self):
        assert not OpenOnsets(self.roll()).hit(40, 0.2)

    @pytest.mark.slow
    def test_a_strike_within_a_span_is_told_if_the_time_does_not_matter(self):
        told = set()
        for start in np.arange(0.0, 0.7, 0.01).tolist():
            for length in (0.01, 0.05, 0.4):
                span = np.linspace(start, start + length, 21).tolist()
                onsets = OpenOnsets(self.roll())
                is_hit = onsets.hit_within(39, span[0], span[-1])
                each = [OpenOnsets(self.roll()) for _ in span]
                hits = [one.hit(39, time) for one, time in zip(each, span, strict=True)]
                assert is_hit is None or set(hits) == {is_hit}
                assert is_hit is None or all(one._times == onsets._times for one in each)
                told.add(is_hit)
        assert told == {True, False, None}
