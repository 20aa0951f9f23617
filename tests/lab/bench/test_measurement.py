"""Order of the runs, medians, ratios and shares, against numbers worked out by hand."""

import pytest

from sb3_piano.lab.bench.measurement import Measurement, Sample, measure


def scripted(name, rates, ratios=None, after=lambda: None):
    """Return a measurement whose runs, of 2 s, have the given rates, the first to warm up."""
    left = iter(rates)

    def run():
        after()
        return Sample(2 * next(left), 2.0)

    return Measurement(name=name, unit="steps/s", run=run, ratios=ratios or {})


def test_every_other_round_goes_backwards():
    order = []
    measurements = [
        scripted(name, [1] * 3, after=lambda name=name: order.append(name)) for name in "abc"
    ]
    measure("simulation", measurements, 2, [])
    assert "".join(order) == "abc" + "cba" + "abc"


def test_a_ratio_is_the_median_of_the_rounds_ratios_not_the_ratio_of_the_medians():
    ratios = {"x of base": ("ours", "base"), "env/bare": ("base", "ours")}
    rows = []
    measurements = [scripted("ours", [1, 10, 30, 20], ratios), scripted("base", [1, 10, 10, 40])]
    measure("simulation", measurements, 3, rows)  # medians 20 and 10
    assert rows[0].ratios == {"x of base": 1.0, "env/bare": 1.0}
    rows.clear()
    measurements = [scripted("ours", [1, 10, 30], ratios), scripted("base", [1, 10, 10])]
    measure("simulation", measurements, 2, rows)
    assert rows[0].ratios == pytest.approx({"x of base": 2.0, "env/bare": (1 + 1 / 3) / 2})


def test_shares_of_time_are_medians_too():
    times = ((1.0, 0.0), (2.0, 1.0), (4.0, 3.2), (1.0, 0.6))
    samples = iter([Sample(1, all_, {"in the learner": part}) for all_, part in times])
    rows = []
    ours = Measurement(name="ours", unit="steps/s", run=lambda: next(samples))
    measure("training", [ours], 3, rows)
    assert rows[0].ratios == pytest.approx({"of the time in the learner": 0.6})


def test_processor_time_has_rates_and_ratios_of_its_own():
    """Here other programs take half of the time, in the second round of ours three quarters."""
    base = [Sample(8, 2.0, processor=1.0)] * 3
    ours = [Sample(8, 4.0, processor=2.0)] * 2 + [Sample(8, 8.0, processor=2.0)]
    rows, ratios = [], {"x of base": ("ours", "base")}
    measurements = [
        Measurement(name="ours", unit="steps/s", run=iter(ours).__next__, ratios=ratios),
        Measurement(name="base", unit="steps/s", run=iter(base).__next__),
    ]
    measure("simulation", measurements, 2, rows)
    assert (rows[0].value, rows[0].processor, rows[1].processor) == (1.5, 4.0, 8.0)
    assert (rows[0].ratios, rows[0].processor_ratios) == ({"x of base": 0.375}, {"x of base": 0.5})


@pytest.mark.parametrize(("stop", "rounds"), [(4, 1), (5, 1), (7, 2)])
def test_the_rounds_that_are_complete_count_when_interrupted(stop, rounds):
    runs = []  # two each round, the first of which warms up

    def count():
        if len(runs) == stop:
            raise KeyboardInterrupt
        runs.append(1)

    rows = []
    measurements = [scripted(name, range(1, 9), after=count) for name in "ab"]
    with pytest.raises(KeyboardInterrupt):
        measure("simulation", measurements, 5, rows)
    assert [list(row.by_round) for row in rows] == [list(range(2, 2 + rounds))] * 2
