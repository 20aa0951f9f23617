"""The file of results: its schema, and the tables that are made of it.

``results.json`` holds one :class:`Result` for each piece, player and physics. Its
``schema_version`` changes when a field does, its ``metrics_version`` when a metric is defined in
another way: results of different metrics are never in one file.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import fmean
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

FILE = Path(__file__).with_name("results.json")

SCHEMA_VERSION: Final = 1
METRICS_VERSION: Final = 1
"""Version of ``sb3_piano.metrics``: the definitions of docs/metrics.md, onsets within 50 ms."""

Share = Annotated[float, Field(ge=0, le=1)]
Name = Annotated[str, Field(min_length=1)]
Physics = Literal["reference", "faithful", "fast-contacts", "fast"]


class Result(BaseModel):
    """How well a player played a piece, with everything that is needed to measure it again."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    piece: Name
    """Name of a built-in piece."""
    score_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    """Digest of its notes and pedals, see ``measure.digest``."""
    player: Name
    """One of ``measure.PLAYERS``."""
    physics: Physics
    seeds: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]
    """One episode was played with each."""
    f1: tuple[Share, ...]
    """Frame F1 of each seed."""
    onset_f1: tuple[Share, ...]
    """Onset F1 of each seed."""
    noop_f1: Share
    """Frame F1 of playing nothing."""
    cpu_seconds: Annotated[float, Field(ge=0)]
    """Time of the processor to plan and play an episode, mean over seeds, s."""
    package_version: Name
    hardware: Name
    command: Name
    """Command that measures it again, in a clone."""
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
        """What there is one result of."""
        return self.piece, self.player, self.physics


class Results(BaseModel):
    """The file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_version: Literal[1] = SCHEMA_VERSION
    metrics_version: Literal[1] = METRICS_VERSION
    results: tuple[Result, ...] = ()

    @model_validator(mode="after")
    def _one_result_for_each_key(self) -> Results:
        keys = [result.key for result in self.results]
        twice = sorted({key for key in keys if keys.count(key) > 1})
        if twice:
            raise ValueError(f"{twice[0]} is there twice: expected one result for each")
        return self

    def merged(self, measured: Iterable[Result]) -> Results:
        """Return these results and new ones, which replace older ones of the same key."""
        by_key = {result.key: result for result in (*self.results, *measured)}
        return Results(results=tuple(by_key[key] for key in sorted(by_key)))

    @classmethod
    def read(cls, file: Path = FILE) -> Results:
        """Return what is in a file; raise pydantic's ``ValidationError`` if it does not fit."""
        return cls.model_validate_json(file.read_bytes())


def score_table(results: Sequence[Result]) -> str:
    """Return F1 and onset F1 by piece and player, and their means, as Markdown.

    A player who has not played every piece has no mean, which would compare different things.
    """
    players = list(dict.fromkeys(result.player for result in results))
    pieces = list(dict.fromkeys(result.piece for result in results))
    by_key = {(result.piece, result.player): result for result in results}
    noop = {result.piece: result.noop_f1 for result in results}
    lines = [
        f"| piece | nothing | {' | '.join(players)} |",
        f"|---|---:|{'---:|' * len(players)}",
    ]
    for piece in pieces:
        found = [by_key.get((piece, player)) for player in players]
        cells = ["" if result is None else scores([result]) for result in found]
        lines.append(f"| {piece} | {noop[piece]:.3f} | {' | '.join(cells)} |")
    means = []
    for player in players:
        of_player = [result for result in results if result.player == player]
        means.append(scores(of_player) if len(of_player) == len(pieces) else "")
    lines.append(f"| **mean** | {fmean(noop.values()):.3f} | {' | '.join(means)} |")
    return "\n".join(lines)


def scores(results: Sequence[Result]) -> str:
    """Return mean F1 and mean onset F1 as a cell."""
    return f"{_mean(r.f1 for r in results):.3f} / {_mean(r.onset_f1 for r in results):.3f}"


def _mean(values: Iterable[Sequence[float]]) -> float:
    return fmean(fmean(of_one) for of_one in values)


def origin_table(results: Sequence[Result]) -> str:
    """Return where each result comes from, as Markdown."""
    head = (
        "| piece | player | seeds | CPU, s | score, sha256 | version | date | hardware | command |"
    )
    lines = [head, "|---|---|---|---:|---|---|---|---|---|"]
    for result in results:
        seeds = ", ".join(map(str, result.seeds))
        lines.append(
            f"| {result.piece} | {result.player} | {seeds} | {result.cpu_seconds:.1f} | "
            f"`{result.score_sha256[:12]}` | {result.package_version} | {result.date} | "
            f"{result.hardware} | `{result.command}` |"
        )
    return "\n".join(lines)
