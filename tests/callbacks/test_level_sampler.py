"""The distribution of prioritized level replay, by hand and by other formulas."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from yaml_rows import Tables

from sb3_piano.callbacks.level_sampler import Level, LevelSampler, gini, score_shares
from sb3_piano.exceptions import ConfigError

tables = Tables(__file__)


def sampler_of(scores, beta=0.5, rho=0.3):
    """Return a sampler whose levels were visited in their order; ``None`` is no score yet."""
    sampler = LevelSampler(scores, beta, rho)
    for name, score in scores.items():
        if score is not None:
            sampler.visit(name)
            sampler.rate(name, score)
    return sampler


class TestByScore:
    def test_the_share_falls_with_a_power_of_the_rank(self):
        # rank^-2 is 1, 1/9 and 1/4 of ranks 1, 3 and 2; their sum is 49/36
        expected = [36 / 49, 4 / 49, 9 / 49]
        np.testing.assert_allclose(score_shares([5.0, 1.0, 3.0], 0.5), expected)
        np.testing.assert_allclose(score_shares([5.0, 1.0, 3.0], 1.0), [6 / 11, 2 / 11, 3 / 11])

    def test_equal_scores_share_the_best_of_their_ranks(self):
        # ranks 2, 4, 2, 1 with beta 1: 1/2, 1/4, 1/2, 1
        expected = [2 / 9, 1 / 9, 2 / 9, 4 / 9]
        np.testing.assert_allclose(score_shares([3.0, 1.0, 3.0, 5.0], 1.0), expected)
        np.testing.assert_allclose(score_shares([0.0] * 4, 0.1), [1 / 4] * 4)
        # the smallest temperature leaves the highest score alone
        shares = score_shares(range(2000), 1e-300)
        assert (shares[-1], shares.sum()) == (1, 1)


class TestDistribution:
    def test_scores_and_ages_are_mixed(self):
        sampler = sampler_of({"a": 1.0, "b": 3.0, "c": 2.0}, beta=1.0, rho=0.3)
        # drawn at 1, 2 and 3 of 3: ages 2, 1, 0; ranks 3, 1, 2
        expected = {
            "a": 0.7 * 2 / 11 + 0.3 * 2 / 3,
            "b": 0.7 * 6 / 11 + 0.3 * 1 / 3,
            "c": 0.7 * 3 / 11,
        }
        assert sampler.probabilities() == pytest.approx(expected)
        sampler.visit("a")  # ages 0, 2, 1
        assert sampler.probabilities()["a"] == pytest.approx(0.7 * 2 / 11)
        assert sampler.probabilities()["b"] == pytest.approx(0.7 * 6 / 11 + 0.3 * 2 / 3)

    def test_rho_chooses_between_both_and_where_none_has_waited_scores_alone_count(self):
        for rho, expected in ((0.0, [2 / 3, 1 / 3]), (1.0, [0.0, 1.0])):
            sampler = sampler_of({"b": 1.0, "a": 2.0}, beta=1.0, rho=rho)
            assert list(sampler.probabilities(["a", "b"]).values()) == pytest.approx(expected)
        assert sampler_of({"a": 1.0, "b": 3.0}, rho=1.0).probabilities(["b"]) == {"b": 1.0}
        only = LevelSampler(["a", "b"], rho=1.0)
        for name in "ab":
            only.rate(name, 1.0)  # as after a restart amid the first episodes
        assert only.probabilities() == {"a": 0.5, "b": 0.5}

    def test_ranks_and_ages_count_among_the_levels_that_may_be_drawn(self):
        sampler = sampler_of({"a": 1.0, "b": 3.0, "c": 2.0}, beta=1.0, rho=0.3)
        found = sampler.probabilities(["a", "c"])
        assert found == pytest.approx({"a": 0.7 / 3 + 0.3, "c": 0.7 * 2 / 3})

    @given(
        st.lists(st.floats(0, 1e6), min_size=1, max_size=20),
        st.floats(0.01, 10),
        st.floats(0, 1),
        st.integers(0, 19),
    )
    def test_it_always_is_a_distribution(self, scores, beta, rho, again):
        sampler = sampler_of({str(i): score for i, score in enumerate(scores)}, beta, rho)
        sampler.visit(str(again % len(scores)))
        found = np.array(list(sampler.probabilities().values()))
        assert found.min() >= 0
        assert found.sum() == pytest.approx(1)


class TestUnseen:
    def test_unseen_levels_come_first_and_are_equally_likely(self):
        sampler = sampler_of({"a": 9.0, "b": None, "c": None})
        assert sampler.unseen() == ["b", "c"]
        assert sampler.probabilities() == {"a": 0.0, "b": 0.5, "c": 0.5}
        assert sampler.probabilities(["a"]) == {"a": 1.0}

    def test_one_that_is_being_played_is_not_drawn_a_second_time(self):
        sampler = sampler_of({"a": 9.0, "b": None, "c": None})
        sampler.visit("b")
        assert sampler.unseen({"b"}) == ["c"]
        assert sampler.probabilities(playing={"b"}) == {"a": 0.0, "b": 0.0, "c": 1.0}
        assert sampler.probabilities(playing={"b", "c"}) == {"a": 1.0, "b": 0.0, "c": 0.0}
        assert sampler.unseen() == ["b", "c"]  # also if that episode was broken off
        first = LevelSampler(["a", "b"]).probabilities(playing={"a", "b"})
        assert first == {"a": 0.5, "b": 0.5}


class TestGini:
    def test_of_the_most_uneven_case_of_the_paper_of_no_counts_and_of_visits(self):
        assert gini([689] + [111 / 29] * 29) == pytest.approx(0.828, abs=5e-4)  # evened out
        assert gini([]) == 0
        sampler = sampler_of({"a": 1.0, "b": 1.0})
        assert sampler.gini == 0
        sampler.visit("a")
        sampler.visit("a")
        assert sampler.gini == pytest.approx(0.25)  # of 3 and 1

    @given(st.lists(st.integers(0, 1000), min_size=1, max_size=30))
    def test_it_is_the_sum_over_all_pairs(self, counts):
        v = np.array(counts)
        total = 2 * len(v) * v.sum()
        by_pairs = np.abs(v[:, None] - v).sum() / total if total else 0.0
        assert gini(counts) == pytest.approx(by_pairs)


class TestState:
    def test_it_survives_json(self):
        sampler = sampler_of({"a": 1.5, "b": None, "c": 0.25})
        state = json.loads(json.dumps(sampler.state_dict()))
        assert state == tables["state"]
        other = LevelSampler(["z"])
        other.load_state_dict(state)
        assert other.state_dict() == state
        for twin in (sampler, other):
            twin.rate("b", 1.0)
        assert other.probabilities() == sampler.probabilities()

    def test_levels_may_come_and_go_and_a_new_score_takes_the_place_of_the_former_one(self):
        sampler = sampler_of({"a": 1.0, "b": 2.0})
        sampler.rate("b", 4.0)
        sampler.set_levels(["c", "b"])
        assert sampler.levels == {"c": Level(), "b": Level(score=4.0, visits=1, last=2)}

    @tables("state, message")
    def test_what_is_no_state_or_score_is_refused(self, state, message):
        sampler = sampler_of({"a": 1.0})
        with pytest.raises(ConfigError, match=message):
            sampler.load_state_dict(state)
        assert list(sampler.levels) == ["a"]
        for score in (-0.1, float("nan"), float("inf")):
            with pytest.raises(ConfigError, match=f"score is {score}: expected a finite number"):
                sampler.rate("a", score)
