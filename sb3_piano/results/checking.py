"""Checking: what a file of results claims is played again."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import NamedTuple

from sb3_piano.results.measuring import (
    DIGITS,
    Measurement,
    hardware,
    measure,
    player_digest,
    score_digest,
    versions,
)
from sb3_piano.results.records import Result


class Check(NamedTuple):
    """What became of a claim."""

    claimed: Result
    problems: tuple[str, ...]
    """What does not hold; empty if all does."""
    differences: tuple[str, ...]
    """What differs between the machine of the file and this one."""

    @property
    def holds(self) -> bool:
        """Whether the claim holds."""
        return not self.problems


def drawn(results: Sequence[Result], count: int | None, seed: int) -> list[Result]:
    """Return so many results, drawn by a seed, each as likely as any other; ``None`` is all."""
    if count is None or count >= len(results):
        return list(results)
    return random.Random(seed).sample(list(results), count)


def check(claimed: Result, tolerance: float = 0.0) -> Check:
    """Play again what a result claims, and compare.

    The digests of score and network must be equal; the scores of each seed within the tolerance,
    after rounding to the decimals of a file. Playing is chaotic: on the same versions and the same
    kind of processor it comes out equal, while elsewhere the last bit of a sum may decide whether a
    finger is caught beside a key.

    Raises:
        ConfigError: If there is no such player.
        RunError: If a run cannot be played, or cannot play the piece.
        ScoreError: If there is no such piece.
    """
    differences = _differences(claimed)
    wrong = [
        f"{what}: claimed {theirs}, here {ours}"
        for what, theirs, ours in (
            ("score_sha256", claimed.score_sha256, score_digest(claimed.piece)),
            ("player_sha256", claimed.player_sha256, player_digest(claimed.player)),
        )
        if theirs != ours
    ]
    if wrong:  # something else would be played
        return Check(claimed, tuple(wrong), differences)
    again = measure(Measurement(claimed.piece, claimed.player, claimed.seeds, claimed.physics))
    for name in ("f1", "onset_f1"):
        pairs = zip(claimed.seeds, getattr(claimed, name), getattr(again, name), strict=True)
        wrong += [
            f"{name} of seed {seed}: claimed {theirs}, played {ours}"
            for seed, theirs, ours in pairs
            if not _equal(theirs, ours, tolerance)
        ]
    if not _equal(claimed.noop_f1, again.noop_f1, tolerance):
        wrong.append(f"noop_f1: claimed {claimed.noop_f1}, played {again.noop_f1}")
    return Check(claimed, tuple(wrong), differences)


def _equal(claimed: float, played: float, tolerance: float) -> bool:
    return round(abs(claimed - played), DIGITS + 2) <= tolerance


def _differences(claimed: Result) -> tuple[str, ...]:
    """Return what differs between where a result was measured and here."""
    found = [
        f"{name} {claimed.versions.get(name, 'unknown')}, here {version}"
        for name, version in versions().items()
        if claimed.versions.get(name) != version
    ]
    if claimed.hardware != hardware():
        found.append(f"{claimed.hardware}, here {hardware()}")
    return tuple(found)
