"""The held-out list: the pieces and seeds of ``held_out.yml``."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from sb3_piano.files import read_table

Index = Annotated[int, Field(ge=0)]


class Generated(BaseModel):
    """Excerpts 0 to n - 1 of generated music."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: Index
    n: Annotated[int, Field(ge=1)]


class HeldOut(BaseModel):
    """The list."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: Literal[1]
    seeds: tuple[Index, ...]
    studies: tuple[str, ...]
    generated: Generated

    @property
    def pieces(self) -> tuple[str, ...]:
        """Names of all pieces, see :func:`~sb3_piano.results.measuring.score_source`."""
        made = self.generated
        return self.studies + tuple(f"generated-{made.seed}-{index}" for index in range(made.n))


@functools.cache
def held_out() -> HeldOut:
    """Return the list that comes with the package."""
    return HeldOut.model_validate(read_table(Path(__file__).with_suffix(".yml")))
