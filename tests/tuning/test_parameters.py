"""Ranges and choices: what trials get, what the store holds, and what YAML says."""

from __future__ import annotations

import json
import math

import optuna
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from optuna.distributions import FloatDistribution

from sb3_piano.exceptions import ConfigError
from sb3_piano.tuning.parameters import Choice, Discount, Float, Int, parse_parameter

NUMBERS = st.floats(-1e6, 1e6)
VALUES = st.one_of(
    st.text("abc_.", min_size=1, max_size=5),
    st.integers(-99, 99),
    st.booleans(),
    st.none(),
    NUMBERS,
    st.lists(st.integers(1, 512), max_size=3),
    st.dictionaries(st.sampled_from(["pi", "qf", "vf"]), st.lists(st.integers(1, 64), max_size=2)),
)


@st.composite
def floats(draw):
    low, high = sorted(draw(st.lists(NUMBERS, min_size=2, max_size=2, unique=True)))
    return Float(low, high, log=low > 0 and draw(st.booleans()))


@st.composite
def stepped_floats(draw):
    hundredths, count = draw(st.integers(1, 50)), draw(st.integers(1, 20))
    low = draw(st.integers(-100, 100))
    return Float(low / 100, (low + count * hundredths) / 100, step=hundredths / 100)


@st.composite
def ints(draw):
    low, count, step = draw(st.integers(-50, 50)), draw(st.integers(1, 20)), draw(st.integers(1, 5))
    log = low > 0 and step == 1 and draw(st.booleans())
    return Int(low, low + count * step, log=log, step=step)


@st.composite
def discounts(draw):
    low, high = sorted(draw(st.lists(st.integers(0, 999), min_size=2, max_size=2, unique=True)))
    return Discount(low / 1000, high / 1000)


@st.composite
def choices(draw):
    values = draw(st.lists(VALUES, min_size=2, max_size=5))
    if draw(st.booleans()):
        values = {f"label {index}": value for index, value in enumerate(values)}
    try:
        return Choice(values)
    except ConfigError:
        return Choice(["a", [64], {"pi": [64]}, None])


PARAMETERS = st.one_of(floats(), stepped_floats(), ints(), discounts(), choices())


def alike(one, other):
    """Return whether two values are the same but for rounding."""
    return one == other or (isinstance(one, float) and math.isclose(one, other, rel_tol=1e-9))


def suggested(parameter, count=5):
    """Return values that trials got, and the trials."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    trials = [study.ask() for _ in range(count)]
    return [parameter.suggest(trial, "x") for trial in trials], study.trials


@settings(max_examples=50, deadline=None)
@given(PARAMETERS)
def test_what_yaml_says_gives_the_parameter_back(parameter):
    plain = parameter.to_plain()
    for same in (plain, json.loads(json.dumps(plain)), yaml.safe_load(yaml.safe_dump(plain))):
        assert parse_parameter("x", same) == parameter
    assert parse_parameter("x", parameter) is parameter


@settings(max_examples=50, deadline=None)
@given(PARAMETERS)
def test_values_of_trials_and_extremes_go_through_the_store_unchanged(parameter):
    values, trials = suggested(parameter)
    for value, trial in zip(values, trials, strict=True):
        (name,) = trial.params
        assert name == parameter.stored_name("x")
        assert parameter.value(trial.params[name]) == value
        assert trial.distributions[name] == parameter.distribution
    for value in [*values, *parameter.extremes()]:
        stored = parameter.stored(value)
        again = parameter.value(stored)
        assert alike(again, value) or isinstance(parameter, Choice)  # 1 and 1.0, two labels
        assert parameter.distribution._contains(parameter.distribution.to_internal_repr(stored))


@given(floats(), st.floats(0, 1e6, exclude_min=True))
def test_what_lies_outside_a_range_is_not_stored(parameter, distance):
    assert parameter.stored(parameter.low - distance - 1e-3) is None
    assert parameter.stored(parameter.high + distance + 1e-3) is None


def test_a_discount_is_searched_evenly_in_the_logarithm_of_its_distance_from_1():
    values, _ = suggested(Discount(0.0, 0.99), count=400)
    assert all(0 <= value <= 0.99 for value in values)
    below = sum(value < 0.9 for value in values)  # half of the way from 1 to 0.01
    assert 150 < below < 250


def test_the_store_calls_a_discount_by_what_it_holds():
    gamma = Discount(0.6, 0.97)
    assert gamma.stored_name("gamma") == "1 - gamma"
    assert gamma.distribution == FloatDistribution(0.03, 0.4, log=True)
    assert (gamma.stored(0.8), gamma.value(0.2)) == (0.2, 0.8)  # exactly: 1 - 0.8 is not 0.2
    assert gamma.suggest(optuna.trial.FixedTrial({"1 - gamma": 0.2}), "gamma") == 0.8


def test_rounding_leads_beyond_neither_end_of_a_discount():
    gamma = Discount(0.1234567890123456, 0.6543210987654321)
    ends = gamma.distribution
    assert gamma.value(ends.low) == gamma.high
    assert gamma.value(math.nextafter(ends.high, 1)) == gamma.low


@pytest.mark.parametrize(
    ("parameter", "value", "stored"),
    [
        (Float(0, 1), "5e-1", 0.5),
        (Float(0, 1), True, None),
        (Float(0, 1), "low", None),
        (Float(0, 1, step=0.1), 0.30000000000000004, 0.30000000000000004),
        (Float(0, 1, step=0.1), 0.25, None),
        (Int(1, 9, step=2), "3", 3),
        (Int(1, 9, step=2), 3.0, 3),
        (Int(1, 9, step=2), 4, None),
        (Int(1, 9), 3.5, None),
        (Discount(0.6, 0.97), "0.8", 0.2),
        (Discount(0.6, 0.97), 0.99, None),
        (Choice([64, 128]), "128", 128),
        (Choice([64, 128]), 256, None),
        (Choice([1, 2]), True, None),
        (Choice(["auto_0.1", "auto"]), "auto", "auto"),
        (Choice([[64], [64, 64]]), (64, 64), "[64, 64]"),
        (Choice({"a": {"pi": [64]}, "b": [64]}), "dict(pi=(64,))", "a"),
        (Choice(["torch.nn.ReLU", "torch.nn.Tanh"]), "nn.Tanh", "torch.nn.Tanh"),
    ],
)
def test_a_value_is_known_however_it_is_written(parameter, value, stored):
    found = parameter.stored(value)
    assert found == stored
    assert type(found) is type(stored)


def test_numbers_that_pyyaml_reads_as_text_are_numbers():
    text = "{a: {float: [1e-4, 1e-2], log: true}, b: {int: [1e0, 1e3]}, c: {float: [0, 1], "
    read = yaml.safe_load(text + "step: 1e-1}}")
    found = {name: parse_parameter(name, value) for name, value in read.items()}
    assert found == {
        "a": Float(1e-4, 0.01, log=True),
        "b": Int(1, 1000),
        "c": Float(0, 1, step=0.1),
    }
    assert type(found["b"].high) is int


def test_neither_what_a_trial_gets_nor_what_it_was_made_of_changes_a_choice():
    layers = [64]
    choice = Choice([layers, [128]])
    layers.append(64)
    choice.value("[64]").append(1)
    choice.extremes()[0].append(1)
    choice.to_plain()["choice"][0].append(1)
    assert choice == Choice([[64], [128]])


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (0.5, r"0.5 cannot be searched. Expected \{float: \[1.0e-4"),
        ({"flaot": [0, 1]}, "cannot be searched. Did you mean 'float'. Expected"),
        ({"float": [0, 1], "int": [0, 1]}, "cannot be searched. Expected"),
        ({"int": [1, 2, 3]}, r"int is \[1, 2, 3\]: expected \[low, high\]"),
        ({"float": [0, 1], "lgo": True}, "Unknown option 'lgo' of float. Did you mean 'log'. Ex"),
        (
            {"discount": [0, 0.9], "log": True},
            "Unknown option 'log' of discount. Expected one of n",
        ),
        ({"float": ["low", 1]}, "low is 'low': expected a number"),
        ({"float": [False, 1]}, "low is False: expected a number"),
        ({"int": [0, 1.5]}, "high is 1.5: expected a whole number"),
        ({"int": [0, 4], "step": None}, "step is None: expected a whole number"),
        ({"float": [0, 1], "log": 1}, "log is 1: expected true or false"),
        ({"float": [2, 1]}, r"\[2.0, 1.0\]\} is no range: expected low below high; a fixed value"),
        ({"float": [0, 1], "log": True}, "is no range: .*low > 0.* must hold"),
        ({"float": [0, 1], "step": 0}, "is no range: .*step > 0.* must hold"),
        ({"float": [0, 1], "step": 0.3}, "is no range: .* not divisible"),
        ({"discount": [0.9, 1]}, "is no range: expected numbers from 0 on, less than 1"),
        ({"choice": "ab"}, "choice is 'ab': expected a list of values, or a mapping"),
        ({"choice": [1]}, r"choice is \[1\]: expected two values or more"),
        ({"choice": [64, 128, 64]}, "expected two values or more, each once"),
        ({"choice": [1, True]}, "with a text of its own in the store"),
        ({"choice": ["[64]", [64]]}, "with a text of its own in the store"),
        ({"choice": {1: 2, 3: 4}}, "choice has the key 1: expected text"),
        ({"choice": [1, {2}]}, r"choice\[1\] is a set, which a run's folder cannot hold"),
    ],
)
def test_what_cannot_be_searched_is_refused_by_name(value, message):
    with pytest.raises(ConfigError, match=f"^Search space: 'tau': .*{message}"):
        parse_parameter("tau", value)
