"""Settings in an RL Zoo entry by their paths, whether it is written in YAML or as text."""

from __future__ import annotations

import ast
import copy
import importlib

import pytest
import torch as th
import yaml
from torch import nn

from sb3_piano.exceptions import ConfigError
from sb3_piano.training import entry_config
from sb3_piano.tuning.search_space.parsing import Choice
from sb3_piano.tuning.search_space.space import Space

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STRETCH = "sb3_piano.wrappers.TemporalStretch"
SCALE = "gymnasium.wrappers.RescaleAction"
ENTRY = {"n_timesteps": 100, "policy": "MlpPolicy"}


def any_value(*names):
    """Return a space that has these settings; the values do not matter."""
    return Space({name: Choice(["a", "b"]) for name in names})


def applied(entry, **settings):
    names = {name.replace("__", "."): value for name, value in settings.items()}
    return any_value(*names).apply(entry, names)


def as_the_zoo_evaluates(text):
    """Evaluate text with the names that RL Zoo has in scope."""
    return eval(text, {"nn": nn, "th": th, "importlib": importlib})


def test_settings_go_where_their_paths_lead():
    entry = {
        **ENTRY,
        "gamma": 0.8,
        "policy_kwargs": {"net_arch": [64], "log_std_init": -2},
        "env_kwargs": {"physics": "fast", "reward_weights": {"energy": 0.01}},
    }
    before = copy.deepcopy(entry)
    result = applied(
        entry,
        gamma=0.9,
        tau=0.01,
        policy_kwargs__net_arch=[8, 8],
        env_kwargs__n_steps_lookahead=3,
        env_kwargs__reward_weights__fingering=0.5,
        replay_buffer_kwargs__a__b=1,
    )
    assert result == {
        **ENTRY,
        "gamma": 0.9,
        "tau": 0.01,
        "policy_kwargs": {"net_arch": [8, 8], "log_std_init": -2},
        "env_kwargs": {
            "physics": "fast",
            "n_steps_lookahead": 3,
            "reward_weights": {"energy": 0.01, "fingering": 0.5},
        },
        "replay_buffer_kwargs": {"a": {"b": 1}},
    }
    assert entry == before


def test_nothing_of_the_result_is_shared_with_entry_or_settings():
    entry = {**ENTRY, "policy_kwargs": {"net_arch": [64]}}
    layers = [8]
    result = any_value("x").apply(entry, {"x": layers})
    result["policy_kwargs"]["net_arch"].append(1)
    result["x"].append(1)
    assert entry["policy_kwargs"] == {"net_arch": [64]}
    assert layers == [8]


def test_what_is_chosen_as_a_whole_can_be_changed_in_part():
    names = {
        "policy_kwargs.net_arch.pi": [1],
        "policy_kwargs": {"net_arch": {"pi": [2], "qf": [3]}},
    }
    result = any_value(*names).apply(ENTRY, names)
    assert result["policy_kwargs"] == {"net_arch": {"pi": [1], "qf": [3]}}


@pytest.mark.parametrize(
    ("wrappers", "result"),
    [
        (None, [{STRETCH: {"factor": 2}}]),
        (STRETCH, [{STRETCH: {"factor": 2}}]),
        ([STRETCH], [{STRETCH: {"factor": 2}}]),
        ({STRETCH: None}, [{STRETCH: {"factor": 2}}]),
        ({STRETCH: {"factor": 1}}, [{STRETCH: {"factor": 2}}]),
        ({"own.TemporalStretch": {"a": 1}}, [{"own.TemporalStretch": {"a": 1, "factor": 2}}]),
        (SCALE, [SCALE, {STRETCH: {"factor": 2}}]),
        (
            [{STRETCH: {"factor": 1}}, {SCALE: {"x": 1}}],
            [{STRETCH: {"factor": 2}}, {SCALE: {"x": 1}}],
        ),
    ],
)
def test_an_argument_of_a_wrapper_goes_to_it_and_an_own_wrapper_that_is_missing_outermost(
    wrappers, result
):
    entry = {**ENTRY, "env_wrapper": wrappers}
    before = copy.deepcopy(entry)
    assert applied(entry, env_wrapper__TemporalStretch__factor=2)["env_wrapper"] == result
    assert entry == before


def test_two_arguments_of_a_missing_wrapper_go_to_one():
    result = applied(
        ENTRY, env_wrapper__FingeringDecay__n_steps=10, env_wrapper__FingeringDecay__start=0.5
    )
    assert result["env_wrapper"] == [
        {"sb3_piano.wrappers.FingeringDecay": {"n_steps": 10, "start": 0.5}}
    ]


def test_wrappers_as_a_whole_and_an_argument_of_one():
    name = "env_wrapper.TemporalStretch.factor"
    settings = {name: 3, "env_wrapper": [SCALE, {STRETCH: {"factor": 1}}]}
    result = any_value(*settings).apply(ENTRY, settings)
    assert result["env_wrapper"] == [SCALE, {STRETCH: {"factor": 3}}]


@pytest.mark.parametrize(
    ("entry", "name", "message"),
    [
        (
            {},
            "env_wrapper.TemporalStrech.factor",
            "env_wrapper has no 'TemporalStrech'. Did you",
        ),
        (
            {"env_wrapper": f"{SCALE}"},
            "env_wrapper.RescaleActoin.low",
            "env_wrapper has no 'RescaleActoin'. Did you mean 'RescaleAction'",
        ),
        (
            {"env_wrapper": [STRETCH, STRETCH]},
            "env_wrapper.TemporalStretch.factor",
            "env_wrapper has TemporalStretch 2 times: expected it once",
        ),
        ({"env_wrapper": [{}]}, "env_wrapper.A.b", r"\{\} is no entry for env_wrapper: expected"),
        ({"gamma": 0.9}, "gamma.x", "gamma is 0.9: expected a mapping that can hold 'x'"),
        (
            {"policy_kwargs": "dict(a=[1])"},
            "policy_kwargs.a.b",
            "policy_kwargs.a is .*: expec",
        ),
        (
            {"policy_kwargs": "dict(a=)"},
            "policy_kwargs.a",
            "'dict\\(a=\\)' is no Python",
        ),
        (
            {"policy_kwargs": "nn.ReLU"},
            "policy_kwargs.a",
            "policy_kwargs is 'nn.ReLU': expe",
        ),
    ],
)
def test_a_path_that_leads_nowhere_is_refused_by_name(entry, name, message):
    with pytest.raises(ConfigError, match=f"^Search space: '{name}': {message}"):
        any_value(name).apply(entry, {name: 1})


# Text that RL Zoo evaluates.


@pytest.mark.parametrize(
    ("text", "settings", "result"),
    [
        (
            "dict(net_arch=[64, 64], activation_fn=nn.ReLU)",
            {"net_arch": [8]},
            "dict(net_arch=[8], activation_fn=nn.ReLU)",
        ),
        (
            "{'net_arch': [64], 'optimizer_class': th.optim.AdamW}",
            {"n_critics": 3},
            "dict(net_arch=[64], optimizer_class=th.optim.AdamW, n_critics=3)",
        ),
        ("dict(a=[8])", {"activation_fn": "nn.ELU"}, "dict(a=[8], activation_fn=nn.ELU)"),
        (
            "dict(net_arch=dict(pi=[64], qf=[32]))",
            {"net_arch.qf": [1, 2]},
            "dict(net_arch=dict(pi=[64], qf=[1, 2]))",
        ),
        (
            "dict(optimizer_kwargs=dict(eps=1e-5), log_std_init=-2)",
            {"optimizer_kwargs.eps": 1e-3, "optimizer_kwargs.betas": (0.5, 0.9)},
            "dict(optimizer_kwargs=dict(eps=0.001, betas=[0.5, 0.9]), log_std_init=-2)",
        ),
        ("dict(a=1)", {"b.c": "it's"}, "dict(a=1, b=dict(c=\"it's\"))"),
        ("dict(a=1)", {"b": {"lambda": 1}}, "dict(a=1, b={'lambda': 1})"),
        ("dict(a=1)", {"b": {"lambda": 1, "x y": None}}, "dict(a=1, b={'lambda': 1, 'x y': None})"),
        (
            "dict(a=1)",
            {"optimizer_class": "torch.optim.Adam"},
            "dict(a=1, optimizer_class=importlib.import_module('torch.optim').Adam)",
        ),
        ("dict(a=1)", {"b": "no.such.Thing"}, "dict(a=1, b='no.such.Thing')"),
    ],
)  # fmt: skip
def test_text_stays_text(text, settings, result):
    names = {f"policy_kwargs.{name}": value for name, value in settings.items()}
    changed = any_value(*names).apply({**ENTRY, "policy_kwargs": text}, names)["policy_kwargs"]
    assert changed == result
    assert type(changed) is str
    assert yaml.safe_load(yaml.safe_dump(changed)) == changed


@pytest.mark.parametrize(
    "policy_kwargs",
    [
        "dict(net_arch=[64, 64], activation_fn=nn.ReLU, n_critics=1)",
        {"net_arch": [64, 64], "activation_fn": "nn.ReLU", "n_critics": 1},
        {"net_arch": [64, 64], "activation_fn": "torch.nn.modules.activation.ReLU", "n_critics": 1},
    ],
)
def test_the_zoo_and_we_understand_the_same(policy_kwargs):
    settings = {"policy_kwargs.net_arch": {"pi": [8], "qf": [16, 16]}}
    entry = any_value(*settings).apply({**ENTRY, "policy_kwargs": policy_kwargs}, settings)
    ours = entry_config("sac", ENV_ID, entry).algorithm_kwargs["policy_kwargs"]
    zoos = as_the_zoo_evaluates(entry["policy_kwargs"])
    assert zoos == {
        "net_arch": {"pi": [8], "qf": [16, 16]},
        "activation_fn": nn.ReLU,
        "n_critics": 1,
    }
    activation = importlib.import_module(ours["activation_fn"].rpartition(".")[0]).ReLU
    assert {**ours, "activation_fn": activation} == zoos


@pytest.mark.parametrize("chosen", ["nn.Tanh", "torch.nn.Tanh"])
def test_a_class_that_is_chosen_makes_text_of_a_mapping(chosen):
    entry = {**ENTRY, "policy_kwargs": {"net_arch": [8]}}
    result = applied(entry, policy_kwargs__activation_fn=chosen)["policy_kwargs"]
    assert result == "dict(net_arch=[8], activation_fn=nn.Tanh)"


def test_a_buffer_class_that_is_chosen_becomes_what_the_zoo_evaluates():
    result = applied(ENTRY, replay_buffer_class="sb3_piano.buffers.CompactReplayBuffer")
    text = result["replay_buffer_class"]
    assert text == "importlib.import_module('sb3_piano.buffers').CompactReplayBuffer"
    assert as_the_zoo_evaluates(text).__name__ == "CompactReplayBuffer"
    assert applied(ENTRY, replay_buffer_class=text)["replay_buffer_class"] == text
    assert entry_config("sac", ENV_ID, result)


def test_env_kwargs_become_a_mapping_for_the_zoo_does_not_evaluate_them():
    entry = {**ENTRY, "env_kwargs": "dict(physics='fast')"}
    assert applied(entry, env_kwargs__n_steps_lookahead=3)["env_kwargs"] == {
        "physics": "fast",
        "n_steps_lookahead": 3,
    }


def test_text_may_be_anything_that_the_zoo_can_have():
    text = "dict(info_keywords=('f1',))"
    result = applied({**ENTRY, "monitor_kwargs": text}, monitor_kwargs__allow_early_resets=True)
    tree = ast.parse(result["monitor_kwargs"], mode="eval")
    assert ast.unparse(tree) == "dict(info_keywords=('f1',), allow_early_resets=True)"
