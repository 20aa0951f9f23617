"""The numbers of the keyboard as a JSON table, and the function that reads it.

``keyboard.json`` holds the 88 keys. The numbers are those of the public RoboPianist simulation
(version 1.0.10, MuJoCo 3.17.0). A model built from them has the same dynamics; what the table
leaves out is MuJoCo's default.
"""

from __future__ import annotations

import functools
import json
from importlib import resources
from typing import Any


@functools.cache
def load_table(name: str) -> dict[str, Any]:
    """Return the table ``<name>.json``, keyboard; callers must not modify it."""
    text = resources.files(__package__).joinpath(f"{name}.json").read_text(encoding="utf-8")
    table: dict[str, Any] = json.loads(text)
    return table
