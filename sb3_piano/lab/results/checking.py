"""Checking: what a file of results claims is played again."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import NamedTuple

from sb3_piano.lab.results.estimates import Estimate
from sb3_piano.lab.results.measuring import (
    DIGITS,
    Measurement,
    hardware,
    measure,
    player_digest,
    score_digest,
    versions,
)
from sb3_piano.lab.results.records import Result

STANDARD_ERRORS = 3.0
"""By how many standard errors of their difference two means may differ, beside the tolerance."""

TOLERANCE = 0.01
"""What may differ by default in any case: few roll-outs tell their own spread badly."""


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


def check(claimed: Result, tolerance: float = TOLERANCE) -> Check:
    """Play again what a result claims, and compare.

    The digests of score and network must be equal. The means over seeds must not differ by more
    than the tolerance and three standard errors of the difference, sqrt(e1^2 + e2^2): playing is
    chaotic, and on another processor the last bit of a sum may decide whether a finger is caught
    beside a key. A single roll-out has no standard error.

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
    again = measure(
        Measurement(
            claimed.piece, claimed.player, claimed.seeds, claimed.physics, claimed.action_noise
        )
    )
    for name in ("f1", "onset_f1", "noop_f1"):
        theirs, ours = (_estimate(r, name) for r in (claimed, again))
        allowed = tolerance + STANDARD_ERRORS * math.hypot(theirs.error or 0, ours.error or 0)
        if round(abs(theirs.mean - ours.mean) - allowed, DIGITS + 2) > 0:
            wrong.append(f"{name}: claimed {theirs}, played {ours}, which may differ {allowed:.3f}")
    return Check(claimed, tuple(wrong), differences)


def _estimate(result: Result, name: str) -> Estimate:
    found = getattr(result, name)
    return Estimate.of(found if isinstance(found, tuple) else (found,))


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
