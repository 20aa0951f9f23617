"""Each number of an episode has words, and one set of them."""

import itertools

import pytest
from yaml_rows import Tables

from sb3_piano.envs import RETURN_KEYS
from sb3_piano.metrics import DEFINITIONS, EPISODE_METRICS
from sb3_piano.metrics.episode import has_value
from sb3_piano.metrics.musicianship import MUSICIANSHIP

tables = Tables(__file__)


def test_every_number_of_an_episode_is_defined_and_no_other():
    expected = [*EPISODE_METRICS, *MUSICIANSHIP, *RETURN_KEYS, "return", "length"]
    assert sorted(DEFINITIONS) == sorted(expected)
    assert all(name == definition.name for name, definition in DEFINITIONS.items())


def test_no_two_numbers_have_the_same_words():
    labels = [definition.label for definition in DEFINITIONS.values()]
    shorts = [(definition.section, definition.short) for definition in DEFINITIONS.values()]
    meanings = [definition.meaning for definition in DEFINITIONS.values()]
    for words in (labels, shorts, meanings):
        assert len(set(words)) == len(words)


def test_what_is_about_the_same_stands_together():
    of_each = [definition.section for definition in DEFINITIONS.values()]
    sections = [section for section, _ in itertools.groupby(of_each)]
    assert len(set(sections)) == len(sections) == 6


@pytest.mark.parametrize("definition", DEFINITIONS.values(), ids=DEFINITIONS)
def test_words_fit_in_a_line_and_end_as_they_should(definition):
    assert definition.meaning.endswith(".")
    assert definition.meaning[0].isupper()
    assert len(definition.meaning) <= 100
    for words in (definition.label, definition.short):
        assert words.startswith("F1") or words[0].islower()
        assert len(words) <= 40
    assert (definition.unit == "ms") == definition.name.endswith("_ms")
    assert (definition.unit == "/s") == definition.name.endswith("_per_second")


@tables("name, value, text")
def test_a_value_has_as_many_decimals_as_are_worth_showing(name, value, text):
    assert DEFINITIONS[name].rounded(value) == text


@tables("name, metrics, expected")
def test_timing_and_fingers_have_a_value_where_something_was_hit(name, metrics, expected):
    assert has_value(name, metrics) is expected
