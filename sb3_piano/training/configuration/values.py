"""Convert values of YAML files and the command line to the types of their parameters."""

from __future__ import annotations

import ast
import collections.abc
import functools
import inspect
import os
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from sb3_piano.exceptions import ConfigError, naming, one_line
from sb3_piano.imports import full_name, import_class, import_name, is_dotted
from sb3_piano.settings import Expected, Number, Whole, checked, number_in, refuse_unknown

_EXAMPLE = "dict(net_arch=[256, 256], activation_fn=nn.ReLU)"


def model_parts() -> tuple[type, ...]:
    """Return the base classes of all classes that an algorithm's arguments may name.

    They cover networks, features extractors and policies; optimizers; and buffers.
    """
    import torch  # here, as players need no torch
    from stable_baselines3.common.buffers import BaseBuffer

    return torch.nn.Module, torch.optim.Optimizer, BaseBuffer


def plain(value: Any, key: str) -> Any:
    """Return a copy in YAML's types: lists for tuples, text for paths, classes and functions."""
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, type | types.FunctionType):
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
    """Parse a Python snippet of RL Zoo's files without ``eval``.

    The snippet has literals, ``dict(name=value)`` and importable names; a name is checked and
    returned as its import path.

    >>> parse_zoo_text("dict(net_arch=[64, 64], n_critics=2)")
    {'net_arch': [64, 64], 'n_critics': 2}
    """
    try:
        parsed = ast.literal_eval(_Zoo().visit(ast.parse(text.strip(), mode="eval").body))
        return plain(parsed, text)
    except ConfigError:
        raise
    except (SyntaxError, ValueError, TypeError, RecursionError, MemoryError) as error:
        raise ConfigError(
            f"{text!r} cannot be read ({one_line(error)}): expected literals, dict(...) and names "
            f"of classes, as in {_EXAMPLE!r}."
        ) from error


class _Zoo(ast.NodeTransformer):
    """Convert the calls and names of a snippet to literals."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        names = [keyword.arg for keyword in node.keywords]
        if ast.unparse(node.func) != "dict" or node.args or None in names:
            return node
        values = [self.visit(keyword.value) for keyword in node.keywords]
        return ast.Dict(keys=[ast.Constant(name) for name in names], values=values)

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return self.visit_Attribute(node)

    def visit_Attribute(self, node: ast.Name | ast.Attribute) -> ast.AST:
        path = full_name(ast.unparse(node))
        import_name(path)
        return ast.Constant(path)


def coerce_mapping(value: Any, key: str) -> dict[str, Any]:
    """Return a mapping with text keys from a mapping or RL Zoo's ``dict(...)`` text."""
    parsed = parse_zoo_text(value) if isinstance(value, str) else value
    if not isinstance(parsed, Mapping) or not all(isinstance(name, str) for name in parsed):
        raise ConfigError(f"{key} is {value!r}: expected a mapping from names to values.")
    return dict(parsed)


def parameters_of(function: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    """Return the parameters of a function or class, with annotations as types where possible."""
    try:
        return inspect.signature(function, eval_str=True).parameters
    except (NameError, TypeError):  # types imported for type checkers only
        return inspect.signature(function).parameters


def check_arguments(
    arguments: Mapping[str, Any],
    function: Callable[..., Any],
    *,
    reserved: Iterable[str] = (),
    also_known: Iterable[str] = (),
) -> dict[str, Any]:
    """Check keyword arguments and convert each value to the type of its parameter.

    ``reserved`` parameters are rejected; ``also_known`` names are suggested for an unknown one.
    """
    parameters = parameters_of(function)
    takes_any = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    variadic = {n for n, p in parameters.items() if p.kind in (p.VAR_KEYWORD, p.VAR_POSITIONAL)}
    refused = {*reserved, *variadic}
    known = [name for name in parameters if name not in refused and not name.startswith("_")]
    given = [name for name in arguments if name in refused or not takes_any]
    owner = getattr(function, "__name__", str(function))
    refuse_unknown(given, known, "key", owner, also_near=also_known)
    return {
        name: coerce(value, parameters[name].annotation, name) if name in known else value
        for name, value in arguments.items()
    }


def coerce(value: Any, annotation: Any, key: str) -> Any:
    """Convert a value to the type of its parameter's annotation.

    Numbers may be text (PyYAML reads ``1e-3`` and ``1.0e6`` as text), whole floats become integers
    for integer parameters, lists become tuples. A schedule may be ``lin_0.001``. Classes stay full
    import paths. Annotations that plain values cannot satisfy accept every value.
    """
    return checked(key, value, _fitted(annotation))


@functools.cache
def _fitted(annotation: Any) -> Any:
    """Return an annotation for YAML values from a library's annotation.

    In unions numbers come before text, so that ``1e-3`` becomes a number.
    """
    options = {typing.get_origin(one) or one: one for one in _options(annotation)}
    kinds = tuple(_KINDS[kind](options[kind]) for kind in _KINDS if kind in options)
    fitted: Any = kinds[0] if kinds else Any
    if len(kinds) > 1:
        fitted = Annotated[typing.Union[kinds], Field(union_mode="left_to_right")]  # noqa: UP007
    return fitted | None if kinds and type(None) in options else fitted


def linear_start(value: Any) -> float | None:
    """Return the ``x`` of ``"lin_x"``, or ``None`` for anything else."""
    if not isinstance(value, str) or not value.startswith("lin_"):
        return None
    start = number_in(value.removeprefix("lin_"))
    return None if isinstance(start, str) else float(start)


def classes_made(value: Any, key: str) -> Any:
    """Return a copy with import paths replaced by their classes."""
    if isinstance(value, dict):
        return {name: classes_made(item, f"{key}.{name}") for name, item in value.items()}
    if isinstance(value, list):
        return [classes_made(item, f"{key}[{index}]") for index, item in enumerate(value)]
    if not isinstance(value, str) or not is_dotted(value):
        return value
    try:
        import_name(value)
    except ConfigError:
        return value  # text with dots; classes were checked with the config
    return class_of(value, model_parts(), key)


def _options(annotation: Any) -> tuple[Any, ...]:
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return typing.get_args(annotation)
    return (annotation,)


def _linear(text: str) -> str:
    if linear_start(text) is None:
        raise ValueError(f"{text!r} is no schedule")
    return text


def _class(option: Any) -> Any:
    """Return the annotation of a class given by import path."""
    bases = tuple(base for base in typing.get_args(option) if isinstance(base, type))

    def full(name: str) -> str:
        import_class(name, *(bases or model_parts()))
        return full_name(name)

    return Annotated[str, AfterValidator(full), Expected("an import path")]


def _mapping(option: Any) -> Any:
    """Return the annotation of a mapping, also given as RL Zoo's ``dict(...)`` text."""
    text = BeforeValidator(lambda v: parse_zoo_text(v) if isinstance(v, str) else v)
    _, items = typing.get_args(option) or (str, Any)
    return Annotated[dict[str, _fitted(items)], text]  # type: ignore[misc]


def _sequence(option: Any) -> Any:
    """Return the annotation of a list or tuple; either may be given."""
    kind = typing.get_origin(option) or option
    items = tuple(one if one is ... else _fitted(one) for one in typing.get_args(option))
    either = BeforeValidator(lambda v: kind(v) if isinstance(v, (list, tuple)) else v)
    return Annotated[kind[items] if items else kind, either]


_KINDS: Mapping[Any, Callable[[Any], Any]] = {
    bool: lambda option: bool,
    int: lambda option: Whole,
    float: lambda option: Number,
    collections.abc.Callable: lambda option: Annotated[
        str, AfterValidator(_linear), Expected("lin_<number>")
    ],
    type: _class,
    dict: _mapping,
    list: _sequence,
    tuple: _sequence,
    str: lambda option: str,
}
"""Function that makes the settings' annotation for each type that plain values can satisfy."""


def class_of(name: str, bases: tuple[type, ...], key: str) -> Any:
    """Import the class that a key names; it must be a subclass of one of ``bases``."""
    with naming(key):
        found = import_class(name, *bases)
    return found
