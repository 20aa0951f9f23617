"""Command-line options from settings classes: name, type, default and help of each field."""

from __future__ import annotations

import argparse
import ast
import dataclasses
import inspect
import re
import textwrap
import typing
from collections.abc import Mapping
from typing import Any

from sb3_piano.cli.common import Add
from sb3_piano.files import load_yaml

_METAVARS = {int: "N", float: "X"}


def add_settings(add: Add, kind: Any, *names: str, **texts: str) -> None:
    """Add an option for each named field of a settings class.

    Its help is the field's docstring, unless ``texts`` has another one. Values are parsed as YAML;
    the class checks them and names the field in its errors.
    """
    known, kinds = _docstrings(kind), typing.get_type_hints(kind)
    fields = {one.name: one for one in dataclasses.fields(kind)}
    for name in names:
        default = fields[name].default
        text = texts.get(name) or known[name]
        if "default" not in text and default not in (None, False, dataclasses.MISSING):
            shown = default if isinstance(default, tuple) else (default,)
            text = f"{text}; default: {' '.join(map(str, shown))}"
        option, bare = f"--{name.replace('_', '-')}", _without_none(kinds[name])
        if bare is bool:
            add(option, text=text)
            continue
        more: dict[str, Any] = {}
        if typing.get_origin(bare) is tuple:
            more["nargs"], bare = "+", typing.get_args(bare)[0]
        metavar = _METAVARS.get(bare, "NAME")
        add(option, metavar, text, load_yaml if bare in _METAVARS else None, **more)


def given(arguments: argparse.Namespace, kind: Any) -> Mapping[str, Any]:
    """Return the settings fields given as options."""
    named = {field.name: getattr(arguments, field.name, None) for field in dataclasses.fields(kind)}
    return {n: value for n, value in named.items() if value is not None and value is not False}


def _without_none(kind: Any) -> Any:
    options = [option for option in typing.get_args(kind) if option is not type(None)]
    return options[0] if type(None) in typing.get_args(kind) else kind


def _docstrings(kind: Any) -> dict[str, str]:
    """Return the docstring of each field of a class as a phrase without markup."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef), "settings are a class"
    found = {}
    for field, text in zip(tree.body, tree.body[1:], strict=False):
        match field, text:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str() as said)),
            ):
                plain = re.sub(r":\w+:`[~.]*([^`]*)`", r"\1", " ".join(said.split()))
                plain = plain.replace("``", "").rstrip(".").replace("%", "%%")
                found[name] = plain[:1].lower() + plain[1:]
    return found
