"""Check a file of results by replaying it."""

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
"""Allowed difference of two means in standard errors, added to the tolerance."""

TOLERANCE = 0.01
"""Default tolerance; few rollouts estimate their standard error poorly."""


class Check(NamedTuple):
    """Outcome of checking a claimed result."""

    claimed: Result
    problems: tuple[str, ...]
    """Deviations from the claim; empty if it holds."""
    differences: tuple[str, ...]
    """Differences between the claim's machine and this one."""

    @property
    def holds(self) -> bool:
        """Whether the claim holds."""
        return not self.problems


def drawn(results: Sequence[Result], count: int | None, seed: int) -> list[Result]:
    """Draw ``count`` results uniformly by a seed; ``None`` returns all."""
    if count is None or count >= len(results):
        return list(results)
    return random.Random(seed).sample(list(results), count)


def check(claimed: Result, tolerance: float = TOLERANCE) -> Check:
    """Replay a claimed result and compare.

    The digests of score and network must be equal. The means over seeds may differ by at most the
    tolerance plus three standard errors of the difference, sqrt(e1^2 + e2^2): playing is chaotic,
    and on another processor the last bit of a sum may decide whether a finger gets stuck beside a
    key. A single rollout has no standard error.

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
    """Return the differences between a result's machine and this one."""
    found = [
        f"{name} {claimed.versions.get(name, 'unknown')}, here {version}"
        for name, version in versions().items()
        if claimed.versions.get(name) != version
    ]
    if claimed.hardware != hardware():
        found.append(f"{claimed.hardware}, here {hardware()}")
    return tuple(found)
