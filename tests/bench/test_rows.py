"""Medians, ratios and shares, against numbers worked out by hand."""

from __future__ import annotations

import pytest

from sb3_piano.bench.rounds import Comparison, Contestant, Lap
from sb3_piano.bench.rows import median_ratio, median_shares, speed_rows


def rounds_of(**rates):
    """Return rounds in which each contestant had the given rates, in laps of 2 s."""
    return [
        {name: Lap(steps=2 * rate, seconds=2.0) for name, rate in zip(rates, each, strict=True)}
        for each in zip(*rates.values(), strict=True)
    ]


def contestant(name, *comparisons):
    return Contestant(name=name, unit="steps/s", play=lambda: None, comparisons=comparisons)


def test_a_ratio_is_the_median_of_the_rounds_ratios_not_the_ratio_of_the_medians():
    rounds = rounds_of(ours=[10, 30, 20], base=[10, 10, 40])  # medians 20 and 10
    assert median_ratio("ours", Comparison(label="", base="base"), rounds) == 1.0


def test_a_ratio_of_times_is_turned_round_in_each_round():
    rounds = rounds_of(ours=[10, 30], base=[10, 10])  # times 1 and 1/3 of the base's
    comparison = Comparison(label="", base="base", of_times=True)
    assert median_ratio("ours", comparison, rounds) == pytest.approx((1 + 1 / 3) / 2)


def test_a_row_has_the_median_rate_and_those_of_all_rounds():
    (row, base) = speed_rows(
        "simulation",
        [contestant("ours", Comparison(label="x of base", base="base")), contestant("base")],
        rounds_of(ours=[9, 1, 4], base=[1, 2, 2]),
    )
    assert (row.part, row.name, row.value, row.unit) == ("simulation", "ours", 4, "steps/s")
    assert row.by_round == (9, 1, 4)
    assert row.ratios == {"x of base": 2.0}
    assert (base.value, base.ratios) == (2, {})


def test_without_a_complete_round_there_are_no_rows():
    assert speed_rows("simulation", [contestant("ours")], []) == ()


def test_shares_are_medians_too_and_the_rest_is_told():
    laps = [
        Lap(steps=1, seconds=2.0, within={"simulation": 0.2, "learner": 1.0}),
        Lap(steps=1, seconds=4.0, within={"simulation": 0.4, "learner": 3.2}),
        Lap(steps=1, seconds=1.0, within={"simulation": 0.3, "learner": 0.6}),
    ]
    assert median_shares(laps) == pytest.approx(
        {
            "of the time in the simulation": 0.1,
            "of the time in the learner": 0.6,
            "of the time elsewhere": 0.1,
        }
    )
    (row,) = speed_rows("training", [contestant("ours")], [{"ours": lap} for lap in laps])
    assert row.ratios == median_shares(laps)
    assert median_shares([Lap(steps=1, seconds=1.0)]) == {}
