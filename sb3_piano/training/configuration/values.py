"""Values of YAML files and the command line, made to fit the parameters that they are for."""

from __future__ import annotations

import ast
import collections.abc
import dataclasses
import inspect
import math
import os
import re
import sys
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import torch
from stable_baselines3.common.buffers import BaseBuffer

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training.configuration.names import full_name, import_class, import_name, is_dotted

MODEL_PARTS = (torch.nn.Module, torch.optim.Optimizer, BaseBuffer)
"""Base classes of what an algorithm's arguments may name: networks, features extractors
and policies, optimizers, buffers."""

_LINEAR = re.compile(r"lin_(?P<start>.+)")
_EXAMPLE = "dict(net_arch=[256, 256], activation_fn=nn.ReLU)"


def plain(value: Any, key: str) -> Any:
    """Return a copy in YAML's types: lists for tuples, text for paths and for classes."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, type):
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, Mapping):
        for name in value:
            if not isinstance(name, str):
                raise ConfigError(f"{key} has the key {name!r}: expected text.")
        return {name: plain(item, f"{key}.{name}") for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, f"{key}[{index}]") for index, item in enumerate(value)]
    raise ConfigError(
        f"{key} is a {type(value).__name__}, which a run's folder cannot hold: expected text, "
        "numbers, lists and mappings (for a score, the path of a file or the name of a piece)."
    )


def parse_zoo_text(text: str) -> Any:
    """Return the plain value of a Python snippet as RL Zoo has them, read without ``eval``.

    Understood are literals, ``dict(name=value)`` and names of importable things; a name is checked
    and returned as text, its import path.

    >>> parse_zoo_text("dict(net_arch=[64, 64], n_critics=2)")
    {'net_arch': [64, 64], 'n_critics': 2}
    """
    try:
        parsed = _parsed(ast.parse(text.strip(), mode="eval").body, text)
    except ConfigError:
        raise
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # the last: too deep
        raise ConfigError(
            f"{text!r} is no Python expression ({error}): expected text like {_EXAMPLE!r}."
        ) from error
    return parsed


def _parsed(node: ast.expr, text: str) -> Any:
    match node:
        case ast.Constant(value=None | bool() | int() | float() | str() as value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -value
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [_parsed(item, text) for item in items]
        case ast.Dict(keys=keys, values=values):
            names = [getattr(key, "value", None) for key in keys]
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords):
            names, values = [k.arg for k in keywords], [k.value for k in keywords]
        case ast.Name() | ast.Attribute():
            path = full_name(ast.unparse(node))
            import_name(path)
            return path
        case _:
            names, values = [None], []
    if not all(isinstance(name, str) for name in names):
        raise ConfigError(
            f"{ast.unparse(node)!r} in {text!r} cannot be read: expected literals, dict(...) and "
            f"names of classes, as in {_EXAMPLE!r}."
        )
    return {name: _parsed(value, text) for name, value in zip(names, values, strict=True)}


def coerce_mapping(value: Any, key: str) -> dict[str, Any]:
    """Return a mapping with text keys, given as such or as the Zoo's ``dict(...)``."""
    parsed = parse_zoo_text(value) if isinstance(value, str) else value
    if not isinstance(parsed, Mapping) or not all(isinstance(name, str) for name in parsed):
        raise ConfigError(f"{key} is {value!r}: expected a mapping from names to values.")
    return dict(parsed)


def parameters_of(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    """Return the parameters of a function or class, with annotations as types where possible."""
    try:
        return inspect.signature(function, eval_str=True).parameters
    except (NameError, TypeError):  # types that its module only imports for type checkers
        known = inspect.signature(function).parameters
    owner: Any = vars(function).get("__init__", function) if inspect.isclass(function) else function
    scope = getattr(owner, "__globals__", vars(sys.modules[function.__module__]))
    return {name: _with_type(parameter, scope) for name, parameter in known.items()}


def _with_type(parameter: inspect.Parameter, scope: dict[str, Any]) -> inspect.Parameter:
    """Return a parameter with its annotation as a type, unless the names in it are not known."""
    text = types.SimpleNamespace(__annotations__={"it": parameter.annotation})
    try:
        annotation = typing.get_type_hints(text, scope, include_extras=True)["it"]
    except (NameError, TypeError):
        return parameter
    return parameter.replace(annotation=annotation)


def check_arguments(
    arguments: Mapping[str, Any],
    function: Callable[..., Any],
    *,
    reserved: Iterable[str] = (),
    also_known: Iterable[str] = (),
) -> dict[str, Any]:
    """Return keyword arguments with each value converted to what its parameter expects.

    Parameters that are ``reserved`` may not be given; names that are ``also_known`` are suggested
    when one is unknown.
    """
    parameters = parameters_of(function)
    takes_any = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    variadic = {n for n, p in parameters.items() if p.kind in (p.VAR_KEYWORD, p.VAR_POSITIONAL)}
    refused = {*reserved, *variadic}
    known = [name for name in parameters if name not in refused and not name.startswith("_")]
    checked = {}
    for name, value in arguments.items():
        if name in known:
            checked[name] = coerce(value, parameters[name].annotation, name)
        elif takes_any and name not in refused:
            checked[name] = value
        else:
            owner = getattr(function, "__name__", str(function))
            raise ConfigError(
                f"Unknown key {name!r} for {owner}.{near_names(str(name), [*known, *also_known])} "
                f"Expected one of {', '.join(known)}."
            )
    return checked


def coerce(value: Any, annotation: Any, key: str) -> Any:
    """Return a value as its parameter's annotation wants it.

    Numbers may be text (PyYAML reads ``1e-3`` and ``1.0e6`` so), whole floats become integers where
    integers are wanted, lists become tuples; where a schedule may stand, ``lin_0.001`` may. Classes
    stay import paths, written in full, and the fields of a dataclass a mapping. Annotations that
    plain values cannot satisfy accept all.
    """
    options = {_kind(option): option for option in _options(annotation)}
    wanted = [kind for kind in _WORDS if kind in options]
    for kind in wanted:
        fitting = _read(kind, options[kind], value, key)
        if fitting is not _UNFIT:
            return fitting
    if not wanted:
        return value
    expected = " or ".join(dict.fromkeys(_WORDS[kind] for kind in options if kind in _WORDS))
    raise ConfigError(f"{key} is {value!r}: expected {expected}.")


def linear_start(value: Any) -> float | None:
    """Return the ``x`` of ``"lin_x"``, or ``None`` for anything else."""
    match = _LINEAR.fullmatch(value) if isinstance(value, str) else None
    return None if match is None else _number(match["start"])


def classes_made(value: Any, key: str) -> Any:
    """Return a copy in which text that is an import path has become the class that it names."""
    if isinstance(value, dict):
        return {name: classes_made(item, f"{key}.{name}") for name, item in value.items()}
    if isinstance(value, list):
        return [classes_made(item, f"{key}[{index}]") for index, item in enumerate(value)]
    if not isinstance(value, str) or not is_dotted(value):
        return value
    try:
        import_name(value)
    except ConfigError:
        return value  # text with dots; what has to be a class was checked with the config
    return class_of(value, MODEL_PARTS, key)


def dataclass_made(value: Any, annotation: Any) -> Any:
    """Return the dataclass of a parameter for a mapping of its fields, anything else as it is."""
    made = [option for option in _options(annotation) if dataclasses.is_dataclass(option)]
    made_of: Any = next(iter(made), None)
    return made_of(**value) if made and isinstance(value, Mapping) else value


def _options(annotation: Any) -> tuple[Any, ...]:
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return typing.get_args(annotation)
    return (annotation,)


def _kind(option: Any) -> Any:
    """Return the key of :data:`_WORDS` that stands for one type."""
    return dict if dataclasses.is_dataclass(option) else typing.get_origin(option) or option


def zoo_number(value: Any) -> Any:
    """Return the number that text stands for, a whole float as an integer; all else as it is."""
    number = _number(value)
    if number is None:
        return value
    return int(number) if number == int(number) else number


def _number(value: Any) -> int | float | None:
    """Return a finite number, also from text; ``None`` for all else, ``True`` included."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    try:
        number = value if isinstance(value, int) else float(value)
        return number if math.isfinite(number) else None
    except (ValueError, OverflowError):  # the latter of whole numbers beyond all floats
        return None


_UNFIT: Any = object()

_WORDS: Mapping[Any, str] = {
    type(None): "null",
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    collections.abc.Callable: "lin_<number>",
    type: "an import path",
    dict: "a mapping",
    list: "a list",
    tuple: "a list",
    str: "text",
}
"""Types that plain values can satisfy, in words, in the order in which they are tried: numbers come
before text, so that ``1e-3`` becomes one where both may stand."""


def _read(kind: Any, option: Any, value: Any, key: str) -> Any:
    """Return a value as one kind of type wants it, or ``_UNFIT``."""
    of = typing.get_args(option)
    if kind in (int, float):
        number = _number(value)
        return _UNFIT if number is None or number != kind(number) else kind(number)
    if kind is collections.abc.Callable:
        return _UNFIT if linear_start(value) is None else value
    if kind is type and isinstance(value, str):
        class_of(value, tuple(base for base in of if isinstance(base, type)) or MODEL_PARTS, key)
        return full_name(value)
    if kind is dict and isinstance(value, (str, Mapping)):
        items = coerce_mapping(value, key)
        if dataclasses.is_dataclass(option):
            made: Any = option
            return check_arguments(items, made)
        return {n: coerce(v, of[1] if of else Any, f"{key}.{n}") for n, v in items.items()}
    if kind in (list, tuple):
        return _read_sequence(kind, of, value, key)
    return value if kind is not type and isinstance(value, kind) else _UNFIT


def _read_sequence(kind: Any, of: tuple[Any, ...], value: Any, key: str) -> Any:
    if not isinstance(value, (list, tuple)):
        return _UNFIT
    if not of or kind is list or of[-1] is Ellipsis:
        of = (of[:1] or (Any,)) * len(value)
    if len(of) != len(value):
        return _UNFIT
    pairs = enumerate(zip(value, of, strict=True))
    return kind(coerce(item, annotation, f"{key}[{i}]") for i, (item, annotation) in pairs)


def class_of(name: str, bases: tuple[type, ...], key: str) -> Any:
    """Return the class below one of some classes that an import path of a key names."""
    try:
        return import_class(name, *bases)
    except ConfigError as error:
        raise ConfigError(f"{key}: {error}") from error
