"""Schema of files of results.

A file has one :class:`Result` per piece, player and physics. Its ``schema_version`` changes with
the fields, its ``metrics_version`` with the definition of a metric: one file never mixes results of
different metrics.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sb3_piano.exceptions import ConfigError
from sb3_piano.files import first_fault, read_file, write_text
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.settings import checked

SCHEMA_VERSION: Final = 3
METRICS_VERSION: Final = 1
"""Version of ``sb3_piano.metrics``: the definitions of docs/metrics.md, onsets within 50 ms."""

Share = Annotated[float, Field(ge=0, le=1)]
Name = Annotated[str, Field(min_length=1)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Physics = Literal["reference", "faithful", "fast-contacts", "fast"]


def physics_named(name: str) -> Physics:
    """Check the name of a physics profile and return it."""
    return checked("physics", name, Physics)


class Result(BaseModel):
    """A player's scores on a piece, with everything needed to repeat the measurement."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    piece: Name
    """Name of a piece, see :func:`~sb3_piano.lab.results.measuring.score_source`."""
    score_sha256: Sha256
    """Digest of its notes and pedals, see :func:`~sb3_piano.lab.results.measuring.digest`."""
    player: Name
    """One of :data:`~sb3_piano.lab.results.measuring.PLAYERS`, or the folder of a run."""
    player_sha256: Sha256 | None
    """Digest of the player's network file; ``None`` if it has none."""
    physics: Physics
    seeds: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]
    """Seeds, one episode each."""
    action_noise: Annotated[float, Field(ge=0)]
    """Standard deviation of the noise on the actions, rad."""
    f1: tuple[Share, ...]
    """Frame F1 of each seed."""
    onset_f1: tuple[Share, ...]
    """Onset F1 of each seed."""
    noop_f1: Share
    """Frame F1 of resting hands."""
    cpu_seconds: Annotated[float, Field(ge=0)]
    """CPU time to plan and play the first episode, s; later ones reuse the plan."""
    package_version: Name
    versions: Mapping[str, str]
    """Versions of Python and of the libraries that affect the numbers."""
    hardware: Name
    command: Name
    """Command that repeats the measurement."""
    date: datetime.date

    @model_validator(mode="after")
    def _one_value_for_each_seed(self) -> Result:
        for name in ("f1", "onset_f1"):
            count = len(getattr(self, name))
            if count != len(self.seeds):
                raise ValueError(
                    f"{name} of {self.piece!r} by {self.player!r} has {count} values: expected one "
                    f"for each of the {len(self.seeds)} seeds"
                )
        return self

    @property
    def key(self) -> tuple[str, str, str]:
        """Unique key of a result: piece, player, physics."""
        return self.piece, self.player, self.physics


class Results(BaseModel):
    """Content of a file of results."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_version: Literal[3] = SCHEMA_VERSION
    metrics_version: Literal[1] = METRICS_VERSION
    results: tuple[Result, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _not_older(cls, found: Any) -> Any:
        version = found.get("schema_version") if isinstance(found, dict) else None
        if version in range(1, SCHEMA_VERSION):
            raise ValueError(
                f"schema_version is {version}, of results without noise: measure them again"
            )
        return found

    @model_validator(mode="after")
    def _one_result_for_each_key(self) -> Results:
        keys = [result.key for result in self.results]
        twice = sorted({key for key in keys if keys.count(key) > 1})
        if twice:
            raise ValueError(f"{twice[0]} is there twice: expected one result for each")
        return self

    def merged(self, measured: Iterable[Result]) -> Results:
        """Return these results with new ones; new ones replace those with the same key."""
        by_key = {result.key: result for result in (*self.results, *measured)}
        return Results(results=tuple(by_key[key] for key in sorted(by_key)))

    @classmethod
    def read(cls, file: Path) -> Results:
        """Read a file.

        Raises:
            ConfigError: If it cannot be read, or does not fit the schema.
        """
        try:
            return cls.model_validate_json(read_file(file))
        except OSError as error:
            raise ConfigError(
                f"'{file}' cannot be read: {error.strerror}. Expected a file of results, which "
                "'sb3-piano results measure' writes."
            ) from error
        except ValidationError as error:
            raise ConfigError(
                f"'{file}' does not fit the schema of results ({first_fault(error)}): expected a "
                "file that 'sb3-piano results measure' writes."
            ) from error

    @classmethod
    def add_to(cls, file: Path, measured: Iterable[Result]) -> None:
        """Merge results into a file, safely among processes.

        Raises:
            ConfigError: If it exists and cannot be read, or does not fit the schema.
            RunError: If it cannot be locked.
        """
        with hold(file.with_name(file.name + LOCK_SUFFIX)):
            known = cls.read(file) if file.is_file() else cls()
            known.merged(measured).write(file)

    def write(self, file: Path) -> None:
        """Write the file for :meth:`read`, one result per line."""
        head = f'{{"schema_version": {self.schema_version}, '
        head += f'"metrics_version": {self.metrics_version}, "results": [\n'
        rows = (json.dumps(r.model_dump(mode="json"), ensure_ascii=False) for r in self.results)
        write_text(file, head + ",\n".join(rows) + "\n]}\n")
