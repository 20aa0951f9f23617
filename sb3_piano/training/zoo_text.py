"""RL Zoo's Python snippets in YAML, ``dict(net_arch=[64, 64])``, read without ``eval``."""

from __future__ import annotations

import ast
from typing import Any

from sb3_piano.exceptions import ConfigError
from sb3_piano.training.import_names import full_name, import_name

_EXAMPLE = "dict(net_arch=[256, 256], activation_fn=nn.ReLU)"


def parse_zoo_text(text: str) -> Any:
    """Return the plain value that a snippet stands for.

    Understood are literals, ``dict(name=value)`` and names of importable things; a name is checked
    and returned as text, its import path.

    >>> parse_zoo_text("dict(net_arch=[64, 64], n_critics=2)")
    {'net_arch': [64, 64], 'n_critics': 2}

    Raises:
        ConfigError: If the text is anything else, or a name cannot be imported.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError) as error:
        raise ConfigError(
            f"{text!r} is no Python expression ({error}): expected text like {_EXAMPLE!r}."
        ) from error
    return _value(tree.body, text)


def _value(node: ast.expr, text: str) -> Any:
    match node:
        case ast.Constant(value=None | bool() | int() | float() | str() as value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -value
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [_value(item, text) for item in items]
        case ast.Dict(keys=keys, values=values):
            return {_key(key, text): _value(v, text) for key, v in zip(keys, values, strict=True)}
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords):
            return {_argument(k, text): _value(k.value, text) for k in keywords}
        case ast.Name() | ast.Attribute():
            return _import_path(node)
    raise ConfigError(
        f"{ast.unparse(node)!r} in {text!r} cannot be read: expected literals, dict(...) and names "
        f"of classes, as in {_EXAMPLE!r}."
    )


def _key(node: ast.expr | None, text: str) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    raise ConfigError(f"A key in {text!r} is no text: expected {{'name': value}}.")


def _argument(keyword: ast.keyword, text: str) -> str:
    if keyword.arg is None:
        raise ConfigError(f"'**' in {text!r} cannot be read: expected dict(name=value).")
    return keyword.arg


def _import_path(node: ast.expr) -> str:
    path = full_name(ast.unparse(node))
    import_name(path)
    return path
