"""Text that RL Zoo evaluates, ``dict(net_arch=[64, 64])``, taken apart and written again."""

from __future__ import annotations

import ast
import keyword
from collections.abc import Mapping
from typing import Any

from sb3_piano.exceptions import ConfigError
from sb3_piano.training.configuration.names import full_name, import_name, is_dotted
from sb3_piano.training.configuration.values import coerce_mapping


class Source(str):
    """A piece of such text: it stands for itself there, where other text is quoted."""


def opened(text: str, key: str) -> dict[str, Any]:
    """Return the items of a text that stands for a mapping, each as it is written.

    Args:
        text: ``dict(name=value)`` or ``{'name': value}``.
        key: Where it was found, for messages.

    Raises:
        ConfigError: If it stands for something else.
    """
    coerce_mapping(text, key)  # raises if it is anything else
    tree = ast.parse(text.strip(), mode="eval").body
    if isinstance(tree, ast.Dict):
        names = [ast.literal_eval(name) for name in tree.keys if name is not None]
        values = tree.values
    else:
        assert isinstance(tree, ast.Call), "checked above"
        names = [item.arg for item in tree.keywords]
        values = [item.value for item in tree.keywords]
    return {name: Source(ast.unparse(value)) for name, value in zip(names, values, strict=True)}


def source(value: Any) -> Source:
    """Return the text for a value in YAML's types; classes are not quoted."""
    if isinstance(value, Source):
        return value
    if isinstance(value, Mapping):
        return _mapping_source(value)
    if isinstance(value, (list, tuple)):
        return Source(f"[{', '.join(map(source, value))}]")
    return _class_source(value) if _is_class(value) else Source(repr(value))


def holds_class(value: Any) -> bool:
    """Return whether a value is, or holds, the import path of something."""
    if isinstance(value, Mapping):
        return any(map(holds_class, value.values()))
    if isinstance(value, (list, tuple)):
        return any(map(holds_class, value))
    return _is_class(value)


def _mapping_source(value: Mapping[str, Any]) -> Source:
    items = {name: source(item) for name, item in value.items()}
    if all(name.isidentifier() and not keyword.iskeyword(name) for name in items):
        return Source(f"dict({', '.join(f'{name}={item}' for name, item in items.items())})")
    return Source(f"{{{', '.join(f'{name!r}: {item}' for name, item in items.items())}}}")


def _is_class(value: Any) -> bool:
    if not isinstance(value, str) or not is_dotted(full_name(value)):
        return False
    try:
        return callable(import_name(value))
    except ConfigError:
        return False  # text with dots


def _class_source(path: str) -> Source:
    module, _, name = full_name(path).rpartition(".")
    if module == "torch.nn":  # RL Zoo has it in scope
        return Source(f"nn.{name}")
    return Source(f"importlib.import_module({module!r}).{name}")
