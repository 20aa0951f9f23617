"""Onset scores: the matching of strikes and notes against slow twins and mir_eval."""

import itertools

import mir_eval
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from yaml_rows import Tables

from sb3_piano.metrics import Onsets, match_onsets, onset_f1, onset_scores, onsets_of
from sb3_piano.metrics.onsets import timing_error

tables = Tables(__file__)


def onsets(*strikes):
    """Return onsets from pairs of time and key."""
    time, key = zip(*strikes, strict=True) if strikes else ((), ())
    return Onsets(time=np.array(time, dtype=float), key=np.array(key, dtype=np.intp))


NOTHING = onsets()


class TestMatching:
    @tables("target, played, pairs, why")
    def test_pairs_of_hand_worked_cases(self, target, played, pairs, why):
        assert match_onsets(onsets(*target), onsets(*played)).tolist() == pairs, why

    @pytest.mark.parametrize(("tolerance", "hits"), [(0.0, 0), (0.1, 1), (0.0999, 0)])
    def test_the_tolerance_can_be_chosen(self, tolerance, hits):
        target, played = onsets((0.0, 1)), onsets((0.1, 1))
        assert len(match_onsets(target, played, tolerance)) == hits
        assert onset_f1(target, played, tolerance) == hits
        assert onset_scores(target, played, tolerance).recall == hits
        assert timing_error(target, played, tolerance).mean == pytest.approx(100 * hits)

    def test_a_tremolo_of_thousands_is_matched_note_by_note(self):
        # Each strike is as near to its own note as to the next, so that all hang together.
        times = np.arange(5000) * 0.1
        key = np.zeros(5000, dtype=np.intp)
        pairs = match_onsets(Onsets(times, key), Onsets(times + 0.05, key))
        np.testing.assert_array_equal(pairs, np.column_stack([np.arange(5000)] * 2))

    def test_onsets_without_a_key_for_each_time_are_refused(self):
        broken = Onsets(np.zeros(3), np.zeros(2, dtype=np.intp))
        message = r"one time for each key, got shapes \(3,\) and \(2,\)"
        with pytest.raises(ValueError, match=message):
            match_onsets(broken, NOTHING)
        with pytest.raises(ValueError, match=message):
            match_onsets(NOTHING, broken)


# Times on a grid of 5 ms hit the bound exactly; two keys make clusters likely.
times = st.integers(0, 60).map(lambda n: n * 0.005) | st.floats(0, 0.3)


@st.composite
def random_onsets(draw, min_size=0, max_size=6):
    strike = st.tuples(times, st.integers(3, 4))
    return onsets(*draw(st.lists(strike, min_size=min_size, max_size=max_size)))


def distance(target, played, i, j):
    """Return a distance in ticks of 0.1 ms, None if the two are no pair."""
    ticks = float(np.around(abs(target.time[i] - played.time[j]), 4))
    return round(ticks * 10_000) if target.key[i] == played.key[j] and ticks <= 0.05 else None


def in_order(target, played, pairs):
    """Whether no two pairs of one key are crossed."""
    return all(
        target.key[i] != target.key[k]
        or (target.time[i] - target.time[k]) * (played.time[j] - played.time[m]) >= 0
        for (i, j), (k, m) in itertools.combinations(pairs, 2)
    )


@pytest.mark.slow
@given(random_onsets(max_size=30), random_onsets(max_size=30))
def test_keeping_the_order_costs_no_hit_and_no_time(target, played):
    matched = match_onsets(target, played)
    assert in_order(target, played, matched.tolist())
    never = 1e6
    cost = np.full((len(target.key), len(played.key)), never)
    for i, j in itertools.product(range(len(target.key)), range(len(played.key))):
        ticks = distance(target, played, i, j)
        if ticks is not None:
            # Unrounded, else crossing two pairs could save a tick.
            cost[i, j] = abs(target.time[i] - played.time[j])
    rows, columns = linear_sum_assignment(cost)
    costs = cost[rows, columns]
    assert len(matched) == np.count_nonzero(costs < never)
    ours = np.abs(target.time[matched[:, 0]] - played.time[matched[:, 1]]).sum()
    assert ours == pytest.approx(costs[costs < never].sum(), abs=1e-4 * max(1, len(matched)))


@pytest.mark.slow
@given(random_onsets(min_size=1, max_size=30), random_onsets(min_size=1, max_size=30))
def test_onset_scores_equal_mir_eval(target, played):
    def intervals(strikes):
        return np.column_stack([strikes.time, strikes.time + 0.1])

    def pitches(strikes):
        return mir_eval.util.midi_to_hz(strikes.key + 21.0)

    *expected, _ = mir_eval.transcription.precision_recall_f1_overlap(
        *(told(strikes) for strikes in (target, played) for told in (intervals, pitches)),
        onset_tolerance=0.05,
        offset_ratio=None,
    )
    assert onset_scores(target, played) == pytest.approx(expected)


class TestScores:
    def test_precision_is_over_strikes_and_recall_over_notes(self):
        target = onsets((0.0, 1), (0.5, 2), (1.0, 3))
        played = onsets((0.0, 1), (0.5, 2), (0.5, 3), (1.2, 3), (1.5, 4))
        assert onset_scores(target, played) == pytest.approx((2 / 5, 2 / 3, 4 / 8))
        assert onset_f1(target, played) == pytest.approx(4 / 8)

    def test_where_nothing_is_due_or_struck(self):
        one = onsets((0.0, 1))
        assert onset_scores(NOTHING, NOTHING) == (1.0, 1.0, 1.0)
        assert onset_scores(one, NOTHING) == (1.0, 0.0, 0.0)
        assert onset_scores(NOTHING, one) == (0.0, 1.0, 0.0)
        for target, played in ((NOTHING, NOTHING), (one, NOTHING), (NOTHING, one)):
            assert match_onsets(target, played).shape == (0, 2)
            assert timing_error(target, played) == (0.0, 0.0)

    def test_timing_errors_are_positive_where_strikes_are_late(self):
        target = onsets((0.0, 1), (0.5, 1), (1.0, 2), (1.5, 2))
        played = onsets((0.04, 1), (0.51, 1), (0.98, 2), (3.0, 2))
        # +40, +10 and -20 ms; the fourth is no hit.
        mean, std = 10.0, np.sqrt((30**2 + 0**2 + 30**2) / 3)
        assert timing_error(target, played) == pytest.approx((mean, std))


class TestWholeSteps:
    def active(self, *steps, n=10):
        array = np.zeros((n, 88), dtype=bool)
        array[list(steps), 40] = True
        return array

    def test_a_strike_falls_on_the_beginning_of_the_first_step(self):
        strikes = onsets_of(self.active(2, 3, 7), control_timestep=0.05)
        np.testing.assert_allclose(strikes.time, [0.1, 0.35])
        assert strikes.key.tolist() == [40, 40]

    @pytest.mark.parametrize(
        ("steps", "f1"), [((2, 3), 0), ((3, 4), 1), ((4, 5), 1), ((5, 6), 1), ((6, 7), 0)]
    )
    def test_one_step_early_or_late_is_a_hit_and_two_are_not(self, steps, f1):
        target, played = (onsets_of(self.active(*s), 0.05) for s in ((4, 5), steps))
        assert onset_f1(target, played) == f1
