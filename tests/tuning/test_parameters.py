"""Ranges and choices: what trials get, what the store holds, and what YAML says."""

from __future__ import annotations

import json
import math

import optuna
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from sb3_piano.exceptions import ConfigError
from sb3_piano.tuning.parameters import Parameter, parse_parameter

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


def parameter(value) -> Parameter:
    return parse_parameter("x", value)


@st.composite
def parameters(draw):
    kind = draw(st.sampled_from(["float", "steps", "int", "discount", "list", "labels"]))
    low, count, step = draw(st.integers(-50, 50)), draw(st.integers(1, 20)), draw(st.integers(1, 5))
    log = low > 0 and draw(st.booleans())
    if kind == "float":
        ends = sorted(draw(st.lists(NUMBERS, min_size=2, max_size=2, unique=True)))
        return parameter({"float": ends, "log": ends[0] > 0 and draw(st.booleans())})
    if kind == "steps":
        ends = [low / 100, (low + count * step) / 100]
        return parameter({"float": ends, "step": step / 100})
    if kind == "int":
        step = 1 if log else step
        return parameter({"int": [low, low + count * step], "log": log, "step": step})
    if kind == "discount":
        ends = sorted(draw(st.lists(st.integers(0, 999), min_size=2, max_size=2, unique=True)))
        return parameter({"discount": [end / 1000 for end in ends]})
    values = draw(st.lists(VALUES, min_size=2, max_size=5))
    try:
        return parameter({"choice": values if kind == "list" else dict(zip("abcde", values))})  # noqa: B905
    except ConfigError:
        return parameter({"choice": ["a", [64], {"pi": [64]}, None]})


def suggested(of, count=5):
    """Return values that trials got, and the trials."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    trials = [study.ask() for _ in range(count)]
    return [of.suggest(trial, "x") for trial in trials], study.trials


@given(parameters())
def test_yaml_and_the_store_give_parameters_and_values_back(of):
    for same in (
        json.loads(json.dumps(of.form)),
        yaml.safe_load(yaml.safe_dump(of.form, sort_keys=False)),
    ):
        assert parameter(same) == of
    values, trials = suggested(of)
    for value, trial in zip(values, trials, strict=True):
        (name,) = trial.params
        assert name == of.stored_name("x")
        assert of.value(trial.params[name]) == value
        assert trial.distributions[name] == of.distribution
    for value in [*values, *of.extremes()]:
        stored = of.stored(value)
        again = of.value(stored)
        rounded = isinstance(again, float) and math.isclose(again, value, rel_tol=1e-9)
        assert again == value or rounded or "choice" in of.form  # 1 and 1.0, two labels
        assert of.distribution._contains(of.distribution.to_internal_repr(stored))


@pytest.mark.parametrize(
    "distribution",
    [
        FloatDistribution(1e-4, 1e-2, log=True),
        FloatDistribution(0, 1, step=0.25),
        IntDistribution(1, 9, step=2),
        CategoricalDistribution(("a", "b")),
    ],
)
def test_optunas_distributions_are_taken_as_they_are(distribution):
    found = parameter(distribution)
    assert found.distribution == distribution
    assert parameter(found.form) == found == parameter(found)


def test_a_discount_is_searched_evenly_in_the_logarithm_of_its_distance_from_1():
    values, _ = suggested(parameter({"discount": [0.0, 0.99]}), count=400)
    assert all(0 <= value <= 0.99 for value in values)
    below = sum(value < 0.9 for value in values)  # half of the way from 1 to 0.01
    assert 150 < below < 250


def test_the_store_calls_a_discount_by_what_it_holds_and_rounding_leads_beyond_neither_end():
    gamma = parameter({"discount": [0.6, 0.97]})
    assert gamma.stored_name("gamma") == "1 - gamma"
    assert gamma.distribution == FloatDistribution(0.03, 0.4, log=True)
    assert (gamma.stored(0.8), gamma.value(0.2)) == (0.2, 0.8)  # exactly: 1 - 0.8 is not 0.2
    low, high = 0.1234567890123456, 0.6543210987654321
    gamma = parameter({"discount": [low, high]})
    assert gamma.value(gamma.distribution.low) == high
    assert gamma.value(math.nextafter(gamma.distribution.high, 1)) == low


@pytest.mark.parametrize(
    ("form", "value", "stored"),
    [
        ({"float": [0, 1]}, "5e-1", 0.5),
        ({"float": [0, 1]}, True, None),
        ({"float": [0, 1]}, "low", None),
        ({"float": [0, 1]}, 1.001, None),
        ({"float": [0, 1], "step": 0.1}, 0.30000000000000004, 0.30000000000000004),
        ({"float": [0, 1], "step": 0.1}, 0.25, None),
        ({"int": [1, 9], "step": 2}, "3", 3),
        ({"int": [1, 9], "step": 2}, 3.0, 3),
        ({"int": [1, 9], "step": 2}, 4, None),
        ({"int": [1, 9]}, 3.5, None),
        ({"discount": [0.6, 0.97]}, "0.8", 0.2),
        ({"discount": [0.6, 0.97]}, 1.5, None),
        ({"choice": [64, 128]}, "128", 128),
        ({"choice": [64, 128]}, 256, None),
        ({"choice": [1, 2]}, True, None),
        ({"choice": ["auto_0.1", "auto"]}, "auto", "auto"),
        ({"choice": [[64], [64, 64]]}, (64, 64), "[64, 64]"),
        ({"choice": {"a": {"pi": [64]}, "b": [64]}}, "dict(pi=(64,))", "a"),
        ({"choice": ["torch.nn.ReLU", "torch.nn.Tanh"]}, "nn.Tanh", "torch.nn.Tanh"),
    ],
)
def test_a_value_is_known_however_it_is_written(form, value, stored):
    found = parameter(form).stored(value)
    assert found == stored
    assert type(found) is type(stored)


def test_numbers_that_pyyaml_reads_as_text_are_numbers():
    read = yaml.safe_load("[{float: [1e-4, 1e-2], log: true}, {int: [1e0, 1e3]}]")
    small, whole = (parameter(value) for value in read)
    assert small.distribution == FloatDistribution(1e-4, 0.01, log=True)
    assert whole.distribution == IntDistribution(1, 1000)


def test_neither_what_a_trial_gets_nor_what_it_was_made_of_changes_a_choice():
    layers = [64]
    choice = parameter({"choice": [layers, [128]]})
    layers.append(64)
    choice.value("[64]").append(1)
    choice.extremes()[0].append(1)
    assert choice == parameter({"choice": [[64], [128]]})


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
        ({"float": ["low", 1]}, "low is 'low': expected a finite number"),
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
