"""Values from YAML and RL Zoo's snippets fit their parameters, or are refused by name."""

from collections.abc import Callable
from typing import Any

import pytest
import torch
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.imports import full_name, import_name
from sb3_piano.training.configuration.values import coerce, parse_zoo_text

tables = Tables(__file__)

UNREAD = r"cannot be read \(.*\): expected literals, dict\(\.\.\.\) and names of classes"
NAMES = {"Any": Any, "RATE": float | Callable[[float], float], "torch": torch}
"""What the annotations in the tables are written with."""


@pytest.mark.parametrize(
    ("value", "annotation", "expected"),
    [
        *tables["a_value_becomes_what_its_parameter_expects"],
        ([1, "episode"], "int | tuple[int, str]", (1, "episode")),
        (["f1", "recall"], "tuple[str, ...]", ("f1", "recall")),
        (object, "Any", object),
    ],
)
def test_a_value_becomes_what_its_parameter_expects(value, annotation, expected):
    fitting = coerce(value, eval(annotation, NAMES), "key")
    assert fitting == expected
    assert type(fitting) is type(expected)


@tables("value, annotation, message")
def test_a_value_that_does_not_fit_is_refused_with_key_value_and_type(value, annotation, message):
    with pytest.raises(ConfigError, match=message):
        coerce(value, eval(annotation, NAMES), "key")


@tables("text, value")
def test_literals_calls_of_dict_and_names_are_understood(text, value):
    assert parse_zoo_text(text) == value


@tables("text, message")
def test_anything_else_is_refused_with_the_part_that_is_wrong(text, message):
    with pytest.raises(ConfigError, match=message or UNREAD):
        parse_zoo_text(text)


@tables("old, now")
def test_what_older_files_name_is_found_where_it_is_now(old, now):
    assert full_name(old) == now
    assert import_name(old) is import_name(now)


def test_a_module_that_fails_while_it_is_imported_is_named(tmp_path, monkeypatch):
    (tmp_path / "broken_module.py").write_text("import missing_package\n")
    (tmp_path / "crashing_module.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match="No module named 'missing_package'"):
        import_name("broken_module.Thing")
    with pytest.raises(ConfigError, match="it raises ZeroDivisionError"):
        import_name("crashing_module.Thing")
