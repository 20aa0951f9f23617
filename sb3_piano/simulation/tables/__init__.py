"""Dimensions and constants of the keyboard as a JSON table, with its reader.

``keyboard.json`` has the 88 keys. The numbers are from the public RoboPianist simulation (version
1.0.10, MuJoCo 3.17.0), and a model built from them has the same dynamics. Other settings are
MuJoCo's defaults.
"""

from __future__ import annotations

import functools
import json
from importlib import resources
from typing import Any


@functools.cache
def load_table(name: str) -> dict[str, Any]:
    """Load the table ``<name>.json`` (keyboard); callers must not modify it."""
    text = resources.files(__package__).joinpath(f"{name}.json").read_text(encoding="utf-8")
    table: dict[str, Any] = json.loads(text)
    return table
