"""Values from YAML and RL Zoo's snippets fit their parameters, or are refused by name."""

from collections.abc import Callable
from typing import Any

import pytest
import torch

from sb3_piano.exceptions import ConfigError
from sb3_piano.imports import full_name, import_name
from sb3_piano.training.configuration.values import coerce, parse_zoo_text

UNREAD = r"cannot be read \(.*\): expected literals, dict\(\.\.\.\) and names of classes"
RATE = float | Callable[[float], float]


@pytest.mark.parametrize(
    ("value", "annotation", "expected"),
    [
        ("1e-3", float, 0.001),  # PyYAML reads both as text
        ("1.0e6", int, 1_000_000),
        (1e6, int, 1_000_000),
        (3, float, 3.0),
        (-19.5, str | float, -19.5),
        ("-19.5", str | float, -19.5),
        ("auto_1.0", str | float, "auto_1.0"),
        ("lin_3e-4", RATE, "lin_3e-4"),
        (True, bool, True),
        (None, int | None, None),
        (4, int | tuple[int, str], 4),
        ([1, "episode"], int | tuple[int, str], (1, "episode")),
        (["f1", "recall"], tuple[str, ...], ("f1", "recall")),
        ([64, "64"], list[int] | dict[str, list[int]] | None, [64, 64]),
        ({"pi": [64.0], "qf": [32]}, list[int] | dict[str, list[int]], {"pi": [64], "qf": [32]}),
        ("dict(pi=[64])", list[int] | dict[str, list[int]], {"pi": [64]}),
        ("nn.GELU", type[torch.nn.Module], "torch.nn.GELU"),
        ("cuda:0", torch.device | str, "cuda:0"),
        (object, Any, object),
        ("anything", "an annotation that is text", "anything"),
    ],
)
def test_a_value_becomes_what_its_parameter_expects(value, annotation, expected):
    fitting = coerce(value, annotation, "key")
    assert fitting == expected
    assert type(fitting) is type(expected)


@pytest.mark.parametrize(
    ("value", "annotation", "message"),
    [
        ("fast", float, "key is 'fast': expected a finite number"),
        ("fast", RATE, r"key is 'fast': expected a finite number or lin_<number>"),
        ("lin_fast", RATE, "key is 'lin_fast': expected a finite number or lin_"),
        (2.5, int, r"key is 2\.5: expected a whole number"),
        (True, int, "key is True: expected a whole number"),
        (True, float, "key is True: expected a finite number"),
        (1, bool, "key is 1: expected true or false"),
        ("yes", bool, "key is 'yes': expected true or false"),
        ("inf", float, "key is 'inf': expected a finite number"),
        (None, float, "key is None: expected a finite number"),
        ([1, 2], int | tuple[int, str], r"key\[1\] is 2: expected text"),
        ({"pi": ["wide"]}, dict[str, list[int]], r"key\['pi'\]\[0\] is 'wide': expected a whole"),
        ("torch.nn.Relu", type[torch.nn.Module], "torch.nn has no 'Relu'. Did you mean 'ReLU'"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_with_key_value_and_type(value, annotation, message):
    with pytest.raises(ConfigError, match=message):
        coerce(value, annotation, "key")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("dict(net_arch=[256, 256])", {"net_arch": [256, 256]}),
        ("dict(info_keywords=('f1',))", {"info_keywords": ["f1"]}),
        ("dict(net_arch=dict(pi=[4], qf=[8]))", {"net_arch": {"pi": [4], "qf": [8]}}),
        ("{'log_std_init': -2, 'a': -0.5}", {"log_std_init": -2, "a": -0.5}),
        (" dict(a=True, b=None, c='x') ", {"a": True, "b": None, "c": "x"}),
        ("dict(activation_fn=nn.ReLU)", {"activation_fn": "torch.nn.ReLU"}),
        ("dict(a=th.optim.Adam, b=torch.nn.GELU)", {"a": "torch.optim.Adam", "b": "torch.nn.GELU"}),
        ("HerReplayBuffer", "stable_baselines3.HerReplayBuffer"),
        ("dict(a=importlib.import_module('torch.nn').ReLU)", {"a": "torch.nn.ReLU"}),
        ('importlib.import_module("torch").nn.GELU', "torch.nn.GELU"),
    ],
)
def test_literals_calls_of_dict_and_names_are_understood(text, value):
    assert parse_zoo_text(text) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "dict(a=__import__('os').getcwd())",
            r"__import__\('os'\).getcwd\(\)\)\" cannot be read .*: expected literals",
        ),
        ("dict(a=open('x'))", UNREAD),
        ("[x for x in (1, 2)]", "'x' is no import path"),
        ("dict(a=2**9)", UNREAD),
        ("dict([('a', 1)])", UNREAD),
        ("dict(**{'a': 1})", UNREAD),
        ("{1: 2}", "has the key 1: expected text"),
        ("dict(a=", UNREAD),
        ("a\0b", UNREAD),
        ("dict(a=nn.Rellu)", "torch.nn has no 'Rellu'. Did you mean 'ReLU'"),
        ("dict(a=nowhere.Thing)", "'nowhere.Thing' cannot be imported: No module named"),
        ("dict(a=thing)", "'thing' is no import path"),
        (
            "dict(a=importlib.import_module('os').system('x'))",
            UNREAD,
        ),
        ("importlib.import_module('a' + 'b').C", "is no import path"),
    ],
)
def test_anything_else_is_refused_with_the_part_that_is_wrong(text, message):
    with pytest.raises(ConfigError, match=message):
        parse_zoo_text(text)


@pytest.mark.parametrize(
    ("old", "now"),
    [
        ("sb3_piano.wrappers.CorpusExcerpt", "sb3_piano.lab.music.CorpusExcerpt"),
        ("sb3_piano.music.Corpus", "sb3_piano.lab.music.Corpus"),
        ("sb3_piano.music.corpus.HELD_OUT", "sb3_piano.lab.music.corpus.HELD_OUT"),
        ("sb3_piano.distillation.DistillConfig", "sb3_piano.lab.distillation.DistillConfig"),
        ("sb3_piano.results.Results", "sb3_piano.lab.results.Results"),
    ],
)
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
