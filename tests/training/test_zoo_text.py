"""The Zoo's snippets are read as data; nothing in them is ever run."""

from __future__ import annotations

import pytest
import torch

from sb3_piano.exceptions import ConfigError
from sb3_piano.training.configuration.names import import_name
from sb3_piano.training.configuration.values import parse_zoo_text


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
        ("dict(a=__import__('os').getcwd())", r"__import__\('os'\).getcwd\(\)\" in .* cannot be"),
        ("dict(a=open('x'))", "cannot be read: expected literals"),
        ("[x for x in (1, 2)]", "cannot be read: expected literals"),
        ("dict(a=2**9)", "cannot be read: expected literals"),
        ("dict(a=f'{1}')", "cannot be read: expected literals"),
        ("dict(a=b'x')", "cannot be read: expected literals"),
        ("dict([('a', 1)])", "cannot be read: expected literals"),
        ("dict(**{'a': 1})", "cannot be read: expected literals"),
        ("{1: 2}", "cannot be read: expected literals"),
        ("{**{}}", "cannot be read: expected literals"),
        ("dict(a=", "is no Python expression"),
        ("a\0b", "is no Python expression"),
        ("dict(a=nn.Rellu)", "torch.nn has no 'Rellu'. Did you mean 'ReLU'"),
        ("dict(a=nowhere.Thing)", "'nowhere.Thing' cannot be imported: No module named"),
        ("dict(a=thing)", "'thing' is no import path"),
        ("dict(a=importlib.import_module('os').system('x'))", "cannot be read: expected literals"),
        ("importlib.import_module('a' + 'b').C", "is no import path"),
    ],
)
def test_anything_else_is_refused_with_the_part_that_is_wrong(text, message):
    with pytest.raises(ConfigError, match=message):
        parse_zoo_text(text)


@pytest.mark.parametrize(
    "name", ["nn.ReLU", "th.nn.ReLU", "torch.nn.ReLU", "torch.nn.modules.ReLU"]
)
def test_a_class_is_found_by_its_import_path(name):
    assert import_name(name) is torch.nn.ReLU


def test_a_nested_name_is_found():
    assert import_name("torch.nn.Module.forward") is torch.nn.Module.forward


def test_a_module_that_fails_while_it_is_imported_is_named(tmp_path, monkeypatch):
    (tmp_path / "broken_module.py").write_text("import missing_package\n")
    (tmp_path / "crashing_module.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match="No module named 'missing_package'"):
        import_name("broken_module.Thing")
    with pytest.raises(ConfigError, match="crashing_module raises ZeroDivisionError"):
        import_name("crashing_module.Thing")
