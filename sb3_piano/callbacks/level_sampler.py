"""Prioritized level replay: draw the next level by its score and its age.

A level is whatever a training may be set to: here a piece. With S_i the score of a level, C_i the
number of the sample in which it was last drawn and c the number of samples so far, a level is drawn
with the probability

    P = (1 - rho) P_S + rho P_C,   P_S ~ rank(S_i)^(-1 / beta),   P_C ~ c - C_i,

where rank 1 is the highest score.

Source: M. Jiang, E. Grefenstette and T. Rocktäschel, "Prioritized Level Replay" (2021), equations 1
to 4, with the defaults of E. Farah, I. Lin and G. Walrath, "Curriculum Strategies for Bimanual
Dexterous Piano Playing in RoboPianist", section 6.1.2; the Gini coefficient is that of 6.1.3.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import Index, NotNegative, Positive, Share, checked, settings


@settings
class Level:
    """Score and visits of a level."""

    score: NotNegative | None = None
    """S_i, the score: how much is left to learn; ``None`` before the first finished episode."""
    visits: Index = 0
    """Number of draws."""
    last: Index = 0
    """C_i: number of the last draw of this level, from 1 on; 0 if it was never drawn."""


class LevelSampler:
    """Scores and visits of levels, and the probability of each to be drawn next.

    It draws nothing itself: the caller draws with its own seed.

    Args:
        levels: Names of the levels.
        beta: Temperature of P_S, above 0: the smaller, the more the highest score is preferred.
        rho: Share of P_C, 0 to 1.

    Raises:
        ConfigError: If ``beta`` or ``rho`` is out of range.
    """

    def __init__(self, levels: Iterable[str], beta: float = 0.5, rho: float = 0.3) -> None:
        self._beta = checked("beta", beta, Positive)
        self._rho = checked("rho", rho, Share)
        self._levels = {name: Level() for name in levels}
        self._samples = 0

    @property
    def levels(self) -> Mapping[str, Level]:
        """Score and visits of each level, by name."""
        return MappingProxyType(self._levels)

    @property
    def gini(self) -> float:
        """Gini coefficient of the visits."""
        return gini([level.visits for level in self._levels.values()])

    def set_levels(self, names: Iterable[str]) -> None:
        """Replace the levels. Known levels keep their scores, new ones are unseen."""
        self._levels = {name: self._levels.get(name, Level()) for name in names}

    def visit(self, name: str) -> None:
        """Count a draw of a level."""
        self._samples += 1
        level = self._levels[name]
        self._levels[name] = replace(level, visits=level.visits + 1, last=self._samples)

    def rate(self, name: str, score: float) -> None:
        """Replace the score of a level.

        Raises:
            ConfigError: If the score is below 0 or not finite.
        """
        self._levels[name] = replace(self._levels[name], score=score)

    def unseen(self, playing: Collection[str] = ()) -> list[str]:
        """Return the levels without a score that no environment is playing."""
        found = (name for name, level in self._levels.items() if level.score is None)
        return [name for name in found if name not in playing]

    def probabilities(
        self, among: Sequence[str] | None = None, playing: Collection[str] = ()
    ) -> dict[str, float]:
        """Return the probabilities of some levels; ranks and ages count among these alone.

        While there are unseen ones, one of those is next, all equally likely. Then it is one of
        those with a score; if there is none yet, they are all equally likely.

        Args:
            among: Levels that may be drawn, at least one; by default all.
            playing: Levels that are being played. One whose first score is still to come is not
                drawn a second time for it.
        """
        among = list(self._levels) if among is None else among
        first = set(self.unseen(playing)).intersection(among)
        scored = [name for name in among if self._levels[name].score is not None]
        found = dict.fromkeys(among, 0.0)
        if first or not scored:
            chosen = first or among
            return found | dict.fromkeys(chosen, 1 / len(chosen))
        shares = self._shares([self._levels[name] for name in scored])
        return found | dict(zip(scored, shares.tolist(), strict=True))

    def _shares(self, levels: Sequence[Level]) -> FloatArray:
        """Return the probabilities of levels with scores."""
        by_score = score_shares([level.score or 0.0 for level in levels], self._beta)
        ages = np.array([self._samples - level.last for level in levels], dtype=np.float64)
        if not ages.any():
            return by_score
        return (1 - self._rho) * by_score + self._rho * ages / ages.sum()

    def state_dict(self) -> dict[str, Any]:
        """Return scores and visits of all levels, in JSON's types."""
        levels = {name: asdict(level) for name, level in self._levels.items()}
        return {"samples": self._samples, "levels": levels}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore the levels of a :meth:`state_dict`.

        Raises:
            ConfigError: If it is no such state.
        """
        if set(state) != {"samples", "levels"}:
            raise ConfigError(
                f"The state of a level sampler has {', '.join(sorted(state)) or 'nothing'}: "
                "expected samples and levels."
            )
        samples = checked("samples", state["samples"], Index)
        levels = checked("levels", state["levels"], Mapping[str, Mapping[str, Any]])
        self._levels = {name: Level(**level) for name, level in levels.items()}
        self._samples = samples


def score_shares(scores: Sequence[float], beta: float) -> FloatArray:
    """Return P_S of levels: rank^(-1 / beta), divided by its sum.

    Equal scores share the best of their ranks: of scores 5, 3, 3, 1 the ranks are 1, 2, 2, 4.
    """
    downwards = -np.asarray(scores, dtype=np.float64)
    ranks = 1 + np.searchsorted(np.sort(downwards), downwards, side="left")
    weights = ranks.astype(np.float64) ** (-1 / beta)
    return np.asarray(weights / weights.sum())


def gini(counts: Sequence[float]) -> float:
    """Return the Gini coefficient of counts: sum_ij |v_i - v_j| / (2 n sum v).

    It is 0 if all are equal and 1 - 1/n if all but one are 0; of nothing but zeros it is 0.
    """
    ordered = np.sort(np.asarray(counts, dtype=np.float64))
    n, total = len(ordered), float(ordered.sum())
    if total == 0:
        return 0.0
    # Of the sorted counts, v_k is the larger one of k pairs and the smaller one of n - 1 - k.
    return float(((2 * np.arange(n) - n + 1) * ordered).sum() / (n * total))
