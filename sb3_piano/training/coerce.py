"""Values from YAML and the command line, made to fit the parameters that they are for."""

from __future__ import annotations

import collections.abc
import dataclasses
import inspect
import math
import re
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import torch
from stable_baselines3.common.buffers import BaseBuffer

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training.import_names import (
    checked_class,
    full_name,
    import_class,
    import_name,
    is_dotted,
)
from sb3_piano.training.zoo_text import parse_zoo_text

MODEL_PARTS = (torch.nn.Module, torch.optim.Optimizer, BaseBuffer)
"""What the classes that an algorithm's arguments name must be below: networks, features extractors
and policies, optimizers, buffers."""

_LINEAR = re.compile(r"lin_(?P<start>.+)")
_UNFIT = object()


def check_arguments(
    arguments: Mapping[str, Any],
    function: Callable[..., Any],
    *,
    reserved: Iterable[str] = (),
    also_known: Iterable[str] = (),
) -> dict[str, Any]:
    """Return keyword arguments with each value converted to what its parameter expects.

    Args:
        arguments: Names and plain values.
        function: The class or function that they are for.
        reserved: Parameters that may not be given.
        also_known: Further names to suggest when one is unknown.

    Raises:
        ConfigError: If a name is unknown or reserved, or a value has the wrong type.
    """
    parameters = parameters_of(function)
    takes_any = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    variadic = {n for n, p in parameters.items() if p.kind in (p.VAR_KEYWORD, p.VAR_POSITIONAL)}
    refused = {*reserved, *variadic}
    known = [name for name in parameters if name not in refused and not name.startswith("_")]
    owner = getattr(function, "__name__", str(function))
    checked = {}
    for name, value in arguments.items():
        if name in known:
            checked[name] = coerce(value, parameters[name].annotation, name)
        elif takes_any and name not in refused:
            checked[name] = value
        else:
            suggestion = near_names(str(name), [*known, *also_known])
            raise ConfigError(
                f"Unknown key {name!r} for {owner}.{suggestion} Expected one of {', '.join(known)}."
            )
    return checked


def parameters_of(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    """Return the parameters of a function or class, with annotations as types where possible."""
    try:
        return inspect.signature(function, eval_str=True).parameters
    except (NameError, TypeError):  # types that its module only imports for type checkers
        return inspect.signature(function).parameters


def coerce(value: Any, annotation: Any, key: str) -> Any:
    """Return a value as its parameter's annotation wants it.

    Numbers may be text (PyYAML reads ``1e-3`` and ``1.0e6`` so), whole floats become integers where
    integers are wanted, lists become tuples; where a schedule may stand, ``lin_0.001`` may. Classes
    stay import paths, written in full, and the fields of a dataclass a mapping. Annotations that
    plain values cannot satisfy accept all.

    Raises:
        ConfigError: If the value does not fit, naming key, value and expected type.
    """
    options = _options(annotation)
    known = [option for option in options if _describe(option) is not None]
    if not known:
        return value
    for option in sorted(known, key=_rank):
        fitting = _fit(value, option, key)
        if fitting is not _UNFIT:
            return fitting
    expected = " or ".join(dict.fromkeys(str(_describe(option)) for option in known))
    raise ConfigError(f"{key} is {value!r}: expected {expected}.")


def accepts_schedule(annotation: Any) -> bool:
    """Return whether a parameter takes a function of the remaining progress."""
    return any(_is_callable(option) for option in _options(annotation))


def linear_start(value: Any) -> float | None:
    """Return the ``x`` of ``"lin_x"``, or ``None`` for anything else."""
    match = _LINEAR.fullmatch(value) if isinstance(value, str) else None
    return None if match is None else _number(match["start"])


def coerce_mapping(value: Any, key: str) -> dict[str, Any]:
    """Return a mapping with text keys, given as such or as the Zoo's ``dict(...)``.

    Raises:
        ConfigError: If it is neither.
    """
    parsed = parse_zoo_text(value) if isinstance(value, str) else value
    if not isinstance(parsed, Mapping) or not all(isinstance(name, str) for name in parsed):
        raise ConfigError(f"{key} is {value!r}: expected a mapping from names to values.")
    return dict(parsed)


def classes_made(value: Any, key: str) -> Any:
    """Return a copy in which text that is an import path has become the class that it names.

    Raises:
        ConfigError: If it names something else than a class of :data:`MODEL_PARTS`.
    """
    if isinstance(value, dict):
        return {name: classes_made(item, f"{key}.{name}") for name, item in value.items()}
    if isinstance(value, list):
        return [classes_made(item, f"{key}[{index}]") for index, item in enumerate(value)]
    if not isinstance(value, str) or not is_dotted(value):
        return value
    try:
        found = import_name(value)
    except ConfigError:
        return value  # text with dots; what has to be a class was checked with the config
    try:
        return checked_class(found, value, *MODEL_PARTS)
    except ConfigError as error:
        raise ConfigError(f"{key}: {error}") from error


def dataclass_made(value: Any, annotation: Any) -> Any:
    """Return the dataclass of a parameter for a mapping of its fields, anything else as it is."""
    made = [option for option in _options(annotation) if _is_dataclass(option)]
    return made[0](**value) if made and isinstance(value, Mapping) else value


def _options(annotation: Any) -> tuple[Any, ...]:
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return typing.get_args(annotation)
    return (annotation,)


def _is_dataclass(option: Any) -> bool:
    return isinstance(option, type) and dataclasses.is_dataclass(option)


def _is_callable(option: Any) -> bool:
    return collections.abc.Callable in (option, typing.get_origin(option)) or option is Callable


def _describe(option: Any) -> str | None:
    """Return in words what fits, or ``None`` if plain values cannot be judged by this type."""
    simple = {
        bool: "true or false", int: "a whole number", float: "a number", str: "text",
        type(None): "null",
    }  # fmt: skip
    if option in simple:
        return simple[option]
    if _is_callable(option):
        return "lin_<number>"
    if _is_dataclass(option):
        return "a mapping"
    origins = {type: "an import path", dict: "a mapping", list: "a list", tuple: "a list"}
    return origins.get(typing.get_origin(option) or option)


def _rank(option: Any) -> int:
    """Numbers come before text, so that ``1e-3`` becomes one where both may stand."""
    ranked = (type(None), bool, int, float)
    return ranked.index(option) if option in ranked else 9 if option is str else 5


def _fit(value: Any, option: Any, key: str) -> Any:
    """Return the value as one type wants it, or ``_UNFIT``."""
    origin = typing.get_origin(option) or option
    if option is type(None):
        return None if value is None else _UNFIT
    if option in (bool, str):
        return value if isinstance(value, option) else _UNFIT
    if option in (int, float):
        return _fit_number(value, option)
    if _is_callable(option):
        return _UNFIT if linear_start(value) is None else value
    if _is_dataclass(option):
        return check_arguments(value, option) if isinstance(value, Mapping) else _UNFIT
    if origin is type:
        return _fit_class(value, typing.get_args(option), key)
    if origin is dict:
        return _fit_mapping(value, typing.get_args(option), key)
    return _fit_sequence(value, origin, typing.get_args(option), key)


def _fit_number(value: Any, kind: type) -> Any:
    number = _number(value)
    if number is None:
        return _UNFIT
    if kind is float:
        return float(number)
    return int(number) if number == int(number) else _UNFIT


def _number(value: Any) -> int | float | None:
    """Return a finite number, also from text; ``None`` for all else, ``True`` included."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    try:
        number = value if isinstance(value, int) else float(value)
        return number if math.isfinite(number) else None
    except (ValueError, OverflowError):  # the latter of whole numbers beyond all floats
        return None


def _fit_class(value: Any, arguments: tuple[Any, ...], key: str) -> Any:
    if not isinstance(value, str):
        return _UNFIT
    bases = tuple(a for a in arguments if isinstance(a, type)) or MODEL_PARTS
    try:
        import_class(value, *bases)
    except ConfigError as error:
        raise ConfigError(f"{key}: {error}") from error
    return full_name(value)


def _fit_mapping(value: Any, arguments: tuple[Any, ...], key: str) -> Any:
    if not isinstance(value, (str, Mapping)):
        return _UNFIT
    annotation = arguments[1] if arguments else Any
    return {
        name: coerce(item, annotation, f"{key}.{name}")
        for name, item in coerce_mapping(value, key).items()
    }


def _fit_sequence(value: Any, kind: type, arguments: tuple[Any, ...], key: str) -> Any:
    if not isinstance(value, (list, tuple)):
        return _UNFIT
    if not arguments:
        annotations: tuple[Any, ...] = (Any,) * len(value)
    elif kind is list or arguments[-1] is Ellipsis:
        annotations = (arguments[0],) * len(value)
    else:
        annotations = arguments
    if len(annotations) != len(value):
        return _UNFIT
    items = (
        coerce(item, annotation, f"{key}[{index}]")
        for index, (item, annotation) in enumerate(zip(value, annotations, strict=True))
    )
    return kind(items)
