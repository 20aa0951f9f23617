"""Statistics of a few numbers, each proved by another road."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from yaml_rows import Tables

from sb3_piano.training.evaluation.statistics import bootstrap_interval, signed_rank_test, summarize

tables = Tables(__file__)


def plain_interval(values, resamples=20_000):
    """The ends between which 95 % of the means of resamples lie, by a loop."""
    random = np.random.default_rng(12345)
    means = [random.choice(values, len(values)).mean() for _ in range(resamples)]
    return np.quantile(means, [0.025, 0.975])


def enumerated_p(differences):
    """The two-sided p of the signed-rank test: count the signs that are at least as one-sided."""
    kept = [d for d in differences if d != 0]
    sizes = np.abs(kept)
    ranks = np.array([np.mean(np.flatnonzero(np.sort(sizes) == size) + 1) for size in sizes])
    middle = ranks.sum() / 2
    distance = abs(ranks[np.array(kept) > 0].sum() - middle)
    signs = itertools.product([0, 1], repeat=len(kept))
    return np.mean([abs(np.dot(sign, ranks) - middle) >= distance - 1e-9 for sign in signs])


@pytest.mark.slow
def test_the_interval_is_that_of_a_plain_resampling_loop():
    values = np.random.default_rng(5).gamma(2.0, 1.0, 25)
    assert bootstrap_interval(values) == pytest.approx(plain_interval(values), abs=0.03)


@given(st.lists(st.floats(0, 1), min_size=2, max_size=8))
def test_an_interval_stays_within_the_values_and_around_their_mean(values):
    interval = bootstrap_interval(values)
    if len(set(values)) == 1:
        assert interval is None
        return
    if interval is not None:
        tolerance = 1e-12
        low, high = interval
        assert min(values) - tolerance <= low <= np.mean(values) + tolerance
        assert np.mean(values) - tolerance <= high <= max(values) + tolerance


def test_a_summary_has_mean_deviation_and_interval():
    """The squares of the distances from the mean 2 are 1, 1, 4 and 4."""
    summary = summarize([1.0, 3.0, 0.0, 4.0])
    assert (summary.n, summary.mean) == (4, 2.0)
    assert summary.std == pytest.approx(np.sqrt(10 / 4))
    assert summary.interval == bootstrap_interval([1.0, 3.0, 0.0, 4.0])
    assert summary.no_interval is None


@tables("values, reason")
def test_where_nothing_varies_there_is_a_reason_in_place_of_an_interval(values, reason):
    summary = summarize(values)
    assert (summary.std, summary.interval, summary.no_interval) == (0.0, None, reason)
    assert summary.mean == pytest.approx(values[0])


@tables("differences")
def test_the_test_is_that_of_trying_all_signs(differences):
    test = signed_rank_test(differences)
    assert test.p == pytest.approx(enumerated_p(differences), abs=1e-12)
    assert test.n == np.count_nonzero(differences)


def test_sizes_that_are_equal_but_for_rounding_share_their_rank():
    exact = signed_rank_test([1.0, -1.0, 1.0, 1.0, 2.0])
    assert signed_rank_test([0.1, -(0.3 - 0.2), 0.4 - 0.3, 0.1, 0.2]) == exact


@tables("differences, reason")
def test_without_two_pairs_that_differ_there_is_a_reason_in_place_of_a_test(differences, reason):
    test = signed_rank_test(differences)
    assert (test.p, test.least_p, test.no_test) == (None, None, reason)
