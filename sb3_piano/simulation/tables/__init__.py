"""The numbers of the simulation as JSON tables, and the function that reads them.

``keyboard.json`` holds the 88 keys, ``shadow_hands.json`` both Shadow Dexterous Hands. The numbers
are those of the public RoboPianist simulation (version 1.0.10, MuJoCo 3.17.0). A model built from
them has the same dynamics; what the tables leave out is MuJoCo's default.
"""

from __future__ import annotations

import functools
import json
from importlib import resources
from typing import Any


@functools.cache
def load_table(name: str) -> dict[str, Any]:
    """Return the table ``<name>.json``, keyboard or shadow_hands; callers must not modify it."""
    text = resources.files(__package__).joinpath(f"{name}.json").read_text(encoding="utf-8")
    table: dict[str, Any] = json.loads(text)
    return table
