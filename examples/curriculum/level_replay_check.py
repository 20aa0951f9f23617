"""Let the sampler of prioritized level replay choose among pieces of known difficulty.

    python examples/curriculum/level_replay_check.py

Nothing is trained: the score of a piece is its difficulty, evenly spaced up to 1, times a little
noise, without which the same piece would always be the hardest. In one half of the table scores
stay as they are however often a piece is played, in the other half each visit takes 3 % off. Every
piece is scored once before the steps that are counted. Gini and the most visits of a piece tell
whether the sampler spreads its draws or locks on to a few pieces, Spearman's rank correlation
whether hard pieces are visited more often. All are means over seeds.

The paper, E. Farah, I. Lin and G. Walrath, "Curriculum Strategies for Bimanual Dexterous Piano
Playing in RoboPianist", section 6.1.3, has a Gini coefficient of 0.85 with beta 0.1, where one of
30 pieces is drawn in 689 of 800 steps, and 0.21 with beta 1. It does not say how scores fall with
practice, nor which rho it took. Its correlation of -0.83 is that of the ranks of scores, 1 for the
highest, with difficulty.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import astuple, dataclass

import numpy as np
from scipy.stats import spearmanr

from sb3_piano.callbacks.level_sampler import LevelSampler, gini

PIECES = 30
STEPS = 800
BETAS = (0.1, 0.25, 0.5, 1.0)
RHOS = (0.1, 0.3)
FALLS = {"stay": 0.0, "fall by 3 %": 0.03}
PAPER = {0.1: (0.85, 689), 1.0: (0.21, None)}
"""Gini coefficient and most visits by beta."""


@dataclass(frozen=True)
class Settings:
    """Settings of the sampler, and what scores do."""

    beta: float
    rho: float
    fall: float
    """By what share a visit lowers the score."""
    noise: float
    steps: int


@dataclass(frozen=True)
class Result:
    """What became of the visits."""

    gini: float
    most_visits: float
    correlation: float
    """Spearman's, of difficulty and visits."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--seeds", type=int, default=5, metavar="N", help="default: 5")
    add("--steps", type=int, default=STEPS, metavar="N", help=f"default: {STEPS}")
    add("--rho", type=float, nargs="+", default=RHOS, help="default: 0.1 0.3")
    about = "standard deviation of a score, as a share of it; default: 0.02"
    add("--noise", type=float, default=0.02, metavar="X", help=about)
    arguments = parser.parse_args()
    print_row("scores", "rho", "beta", "Gini", "most visits", "Spearman", "paper: Gini", "visits")
    print_row(*["---"] + ["---:"] * 7)
    for scores, fall in FALLS.items():
        for rho in arguments.rho:
            for beta in BETAS:
                settings = Settings(beta, rho, fall, arguments.noise, arguments.steps)
                found = mean_result(settings, range(arguments.seeds))
                numbers = f"{found.gini:.2f}", f"{found.most_visits:.0f}"
                in_paper = ["-" if number is None else number for number in PAPER.get(beta, "--")]
                print_row(scores, rho, beta, *numbers, f"{found.correlation:.2f}", *in_paper)


def mean_result(settings: Settings, seeds: Iterable[int]) -> Result:
    """Return means over seeds."""
    results = [astuple(played(settings, seed)) for seed in seeds]
    return Result(*map(float, np.mean(results, axis=0)))


def played(settings: Settings, seed: int) -> Result:
    """Return what the sampler does, a step being an episode."""
    random = np.random.default_rng(seed)
    difficulty = {f"piece {i}": (i + 1) / PIECES for i in range(PIECES)}
    sampler = LevelSampler(difficulty, settings.beta, settings.rho)

    def play(name: str) -> None:
        sampler.visit(name)
        left = difficulty[name] * (1 - settings.fall) ** sampler.levels[name].visits
        sampler.rate(name, left * abs(1 + settings.noise * random.normal()))

    for name in random.permutation(list(difficulty)):
        play(str(name))
    for _ in range(settings.steps):
        likely = sampler.probabilities()
        play(str(random.choice(list(likely), p=list(likely.values()))))
    visits = [level.visits - 1 for level in sampler.levels.values()]  # without the first one
    correlation = spearmanr(list(difficulty.values()), visits).statistic
    return Result(gini(visits), max(visits), float(correlation))


def print_row(*cells: object) -> None:
    """Print a row of a Markdown table."""
    print(f"| {' | '.join(map(str, cells))} |")


if __name__ == "__main__":
    main()
