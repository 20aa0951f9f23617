"""The held-out list: the pieces and seeds of ``held_out.yml``."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import NamedTuple

from sb3_piano.files import read_table


class HeldOut(NamedTuple):
    """The held-out list."""

    seeds: tuple[int, ...]
    pieces: tuple[str, ...]
    """Names of all pieces, see :func:`~sb3_piano.lab.results.measuring.score_source`."""


@functools.cache
def held_out() -> HeldOut:
    """Load the package's held-out list."""
    found = read_table(Path(__file__).with_suffix(".yml"))
    made = found["generated"]  # excerpts 0 to n - 1
    generated = (f"generated-{made['seed']}-{index}" for index in range(made["n"]))
    return HeldOut(seeds=tuple(found["seeds"]), pieces=(*found["studies"], *generated))
