"""Hyperparameter files in RL Zoo's form, and the presets that come with the package."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.imports import full_name, import_name
from sb3_piano.training import load_config
from sb3_piano.training.configuration.values import coerce, parse_zoo_text

tables = Tables(__file__)
ZOO_FILE = Path(__file__).parents[1] / "data" / "zoo_td3.yml"


def test_an_entry_of_the_zoo_is_split_into_run_and_algorithm():
    config = load_config("td3", "Pendulum-v1", ZOO_FILE)
    assert (config.n_timesteps, config.n_envs, config.noise_std) == (10_000, 2, 0.1)
    assert [plugin.path.rpartition(".")[2] for plugin in config.env_wrapper] == [
        "RescaleAction",
        "FlattenObservation",
    ]
    assert config.algorithm_kwargs == {
        "buffer_size": 1000,
        "learning_rate": 0.00073,
        "policy_kwargs": {"net_arch": [64, 64], "activation_fn": "torch.nn.ReLU"},
    }


def test_default_stands_for_all_other_environments(tmp_path):
    path = tmp_path / "a.yml"
    path.write_text("default: {n_timesteps: 5}\nPendulum-v1: {n_timesteps: 7}\n")
    assert load_config("sac", "Pendulum-v1", path).n_timesteps == 7
    assert load_config("sac", "gymnasium:Pendulum-v1", path).n_timesteps == 7
    assert load_config("sac", "MountainCarContinuous-v0", path).n_timesteps == 5


def test_a_file_may_have_settings_for_several_algorithms_each(tmp_path):
    path = tmp_path / "a.yml"
    path.write_text("""
default:
  n_timesteps: 5
  gamma: 0.9
  policy_kwargs: {net_arch: [8]}
  algorithms:
    td3: {policy_delay: 3, gamma: 0.8}
    sac: {policy_kwargs: {log_std_init: -1}}
""")
    arguments = load_config("td3", "Pendulum-v1", path).algorithm_kwargs
    shared = {"policy_kwargs": {"net_arch": [8]}, "gamma": 0.8}
    assert arguments == {**shared, "policy_delay": 3}
    arguments = load_config("sac", "Pendulum-v1", path, gamma=0.7).algorithm_kwargs
    shared = {"net_arch": [8], "log_std_init": -1}
    assert arguments == {"policy_kwargs": shared, "gamma": 0.7}
    with pytest.raises(ConfigError, match=r"'default': .*algorithm of this file 'ddpg'.* td3, sac"):
        load_config("ddpg", "Pendulum-v1", path)


def test_overrides_replace_keys_and_env_kwargs_are_added_and_wrong_ones_are_named():
    changes = {"n_timesteps": 50, "gamma": "0.5", "seed": 0}
    given = {"max_episode_steps": 9, "g": 5.0}
    config = load_config("td3", "Pendulum-v1", ZOO_FILE, **changes, env_kwargs=given)
    assert (config.n_timesteps, config.seed) == (50, 0)
    assert config.algorithm_kwargs["gamma"] == 0.5
    assert config.env_kwargs == {"max_episode_steps": 9, "render_mode": None, "g": 5.0}
    for env_id, file, wrong, message in (
        ("Pendulum-v9", ZOO_FILE, {}, r"^Unknown environment 'Pendulum-v9'"),
        ("MountainCar-v0", ZOO_FILE, {}, r"td3\.yml' has no entry for 'MountainCar-v0'. Did you"),
        ("Pendulum-v1", ZOO_FILE, {"n_envs": 0}, "'Pendulum-v1' with n_envs replaced: n_envs is 0"),
        ("Pendulum-v1", [1], {}, r"config is \[1\]: expected a YAML file"),
    ):
        with pytest.raises(ConfigError, match=message):
            load_config("td3", env_id, file, **wrong)


NESTED = "a: &a0 [1]\n" + "".join(f"b{i}: &a{i + 1} [*a{i}, *a{i}]\n" for i in range(30))
UNUSABLE = [
    *tables["a_file_that_cannot_be_used_is_named_with_the_reason_in_a_line"],
    (f"default: {{n_timesteps: {'1' * 5000}}}", "is not valid YAML: Exceeds the limit"),
    (NESTED, "nested without end"),
    ("a: " + "[" * 100_000, "nested deeper than 50 levels"),
    ("a: " + "- " * 5000, "not valid YAML"),
    ("a: " + "x" * 2**21, "more than 2097152 bytes"),
    (b"\xff\xfe\xff", r"a\.yml' cannot be read: it is not UTF-8"),
]


@pytest.mark.parametrize(("content", "message"), UNUSABLE, ids=range(19))
def test_a_file_that_cannot_be_used_is_named_with_the_reason_in_a_line(tmp_path, content, message):
    path = tmp_path / "a.yml"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ConfigError, match=message) as caught:
        load_config("td3", "Pendulum-v1", path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1500


# Values from YAML and RL Zoo's snippets fit their parameters, or are refused by name.


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
