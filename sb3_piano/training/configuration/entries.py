"""Entries of RL Zoo's YAML files: read and change settings by path, write an entry."""

from __future__ import annotations

import copy
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym

import sb3_piano.wrappers
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import ConfigError, naming
from sb3_piano.files import dump_yaml, write_text
from sb3_piano.imports import full_name, import_name, is_dotted
from sb3_piano.training.configuration.names import registered_id
from sb3_piano.training.configuration.plugins import parse_plugins
from sb3_piano.training.configuration.values import coerce_mapping
from sb3_piano.training.configuration.yaml_files import entry_config, load_entry

_WRAPPERS = "env_wrapper"
_EVALUATED = ("policy_kwargs", "replay_buffer_class", "replay_buffer_kwargs")
"""Keys whose text RL Zoo evaluates; only there can it name a class."""
_PLUGINS = ("env_wrapper", "vec_env_wrapper", "callback")
_OPTIONS = ("vec_env", "num_threads", "matmul_precision")
"""Settings that are options of ``sb3-piano train``."""
# RL Zoo sets these itself, and passes unknown keys to the algorithm.
_NOT_IN_ZOO = ("seed", "device", "verbose", "pieces", *_OPTIONS)


def setting_at(entry: Mapping[str, Any], name: str, default: Any = None) -> Any:
    """Return the setting at a path such as ``policy_kwargs.net_arch``, or ``default``."""
    keys = name.split(".")
    tree: Any = entry
    if keys[0] == _WRAPPERS and keys[1:]:
        tree = {_WRAPPERS: {key: kwargs for key, (_, kwargs) in _by_class(entry).items()}}
    for key in keys:
        try:
            tree = coerce_mapping(tree, name)[key]
        except (ConfigError, KeyError):  # no mapping, or no such key
            return default
    return tree


def with_settings(entry: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of an entry with settings at their paths; missing mappings are made.

    Shorter paths are set first, as longer ones may change parts of them. Text that RL Zoo evaluates
    becomes a mapping if a path leads into it. ``env_wrapper.<class>.<argument>`` names the wrapper
    of that class; a missing wrapper of ``sb3_piano.wrappers`` is added outermost.

    Raises:
        ConfigError: If a path leads into a value that is no mapping.
    """
    changed = copy.deepcopy(dict(entry))
    for name in sorted(settings, key=lambda name: name.count(".")):
        keys, value = name.split("."), copy.deepcopy(settings[name])
        with naming(repr(name)):
            if keys[0] == _WRAPPERS and keys[1:]:
                changed[_WRAPPERS] = _with_argument(changed, keys[1:], value)
            else:
                changed = _with_value(changed, keys, value, "the entry")
    return changed


def _with_value(tree: Any, keys: Sequence[str], value: Any, where: str) -> Any:
    if not keys:
        return value
    branches = coerce_mapping({} if tree is None else tree, where)
    key, *rest = keys
    return {**branches, key: _with_value(branches.get(key), rest, value, key)}


def _with_argument(entry: Mapping[str, Any], keys: Sequence[str], value: Any) -> list[Any]:
    """Return the wrappers with one argument changed; the path begins with the class name."""
    (name, *rest), wrappers = keys, _by_class(entry)
    path, kwargs = wrappers.get(name, (f"{sb3_piano.wrappers.__name__}.{name}", {}))
    wrappers[name] = path, _with_value(kwargs, rest, value, name)
    return [{path: kwargs} for path, kwargs in wrappers.values()]


def _by_class(entry: Mapping[str, Any]) -> dict[str, tuple[str, Any]]:
    """Return import path and arguments of each wrapper by class name."""
    wrappers = parse_plugins(entry.get(_WRAPPERS), _WRAPPERS, gym.Wrapper)
    found = {w.path.rpartition(".")[2]: (w.path, dict(w.kwargs)) for w in wrappers}
    if len(found) < len(wrappers):
        raise ConfigError(f"{_WRAPPERS} has a class twice: expected each of {list(found)} once.")
    return found


def zoo_entry(
    algo: str, env_id: str, entry: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Convert an entry to stock RL Zoo's format; also return the keys unknown to RL Zoo.

    Numbers are written as numbers, ``env_kwargs`` as a mapping, and mappings with classes as text
    that RL Zoo evaluates. The order of the keys is kept.

    Raises:
        ConfigError: If a setting is not valid.
    """
    mapping = entry_config(algo, env_id, entry).to_mapping()
    values = {**mapping, **mapping["algorithm_kwargs"]}
    written, left_out = {}, {}
    for name in dict.fromkeys((*entry, "policy")):  # RL Zoo has no default policy
        if name in _NOT_IN_ZOO:
            left_out[name] = entry[name]  # as written: a collection may have many pieces
        elif values[name] is not None or not name.startswith("noise_"):
            written[name] = _zoo_form(name, values[name])
    return written, left_out


def train_commands(algo: str, env_id: str, file: Path, entry: Mapping[str, Any]) -> dict[str, str]:
    """Return the commands that train with an entry: ours and that of stock RL Zoo.

    RL Zoo has no ``pieces``; for an entry with them only our command is returned.
    """
    written, left_out = zoo_entry(algo, env_id, entry)
    module, name = registered_id(env_id)
    ours = ["sb3-piano", "train", "--algo", algo]
    pieces = left_out.get("pieces")
    several = [pieces] if isinstance(pieces, str) else map(str, pieces or ())
    ours += ["--pieces", *several] if pieces else ["--env", env_id]
    ours += ["--config", str(file)]
    for option in _OPTIONS:
        if left_out.get(option) is not None:
            ours += [f"--{option.replace('_', '-')}", str(left_out[option])]
    if pieces:
        return {"Train": shlex.join(ours)}
    zoo = ["python", "-m", "rl_zoo3.train", "--algo", algo, "--env", name]
    zoo += ["--gym-packages", module or "sb3_piano", "--conf-file", str(file)]
    if written.get("env_kwargs"):  # which RL Zoo does not hand to its evaluations
        zoo += ["--eval-env-kwargs", *(f"{k}:{v!r}" for k, v in written["env_kwargs"].items())]
    return {"Train": shlex.join(ours), "Train in RL Zoo": shlex.join(zoo)}


def write_entry(
    file: Path, algo: str, env_id: str, entry: Mapping[str, Any], comment: Iterable[str]
) -> None:
    """Write a YAML file for ``train --config`` and stock RL Zoo (``--conf-file``).

    Comment lines come first; they also list the keys left out because RL Zoo does not know them.
    """
    written, left_out = zoo_entry(algo, env_id, entry)
    lines = [*comment]
    if left_out:
        pairs = ", ".join(f"{name}: {value}" for name, value in left_out.items())
        lines.append(f"Left out, as RL Zoo has no such key: {pairs}.")
    head = "".join(f"# {' '.join(line.splitlines())}\n" for line in lines)
    write_text(file, head + _zoo_text({registered_id(env_id)[1]: written}))


def zoo_preset(algo: str, name: str) -> str:
    """Return the ``default`` entry of a named preset as the text of a file for stock RL Zoo."""
    entry = load_entry(algo, GENERAL_ID, name)
    return _zoo_text({"default": zoo_entry(algo, GENERAL_ID, entry)[0]})


def _zoo_text(entries: Mapping[str, Any]) -> str:
    # Without a flow style, each list is written on one line.
    style: dict[str, Any] = {"default_flow_style": None, "width": 100, "allow_unicode": True}
    return dump_yaml(entries, **style)


def _zoo_form(name: str, value: Any) -> Any:
    """Return a setting in RL Zoo's form: wrappers by name, evaluated values as text."""
    if name in _PLUGINS:
        return [plugin if kwargs else path for plugin in value for path, kwargs in plugin.items()]
    if name == "monitor_kwargs" and value:  # Monitor wants tuples, which YAML does not have
        return repr({k: tuple(v) if isinstance(v, list) else v for k, v in value.items()})
    text = _source(value)
    return text if name in _EVALUATED and text != repr(value) else value


def _source(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{name!r}: {_source(item)}' for name, item in value.items())}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_source, value))}]"
    if not isinstance(value, str) or not is_dotted(full_name(value)):
        return repr(value)
    try:
        import_name(value)
    except ConfigError:
        return repr(value)  # text with dots
    module, _, name = full_name(value).rpartition(".")
    # RL Zoo has torch.nn in scope.
    return f"nn.{name}" if module == "torch.nn" else f"importlib.import_module({module!r}).{name}"
