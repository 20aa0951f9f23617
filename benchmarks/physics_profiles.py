"""What a learned policy makes of each physics profile, and what a control step takes there.

    python benchmarks/physics_profiles.py --excerpts 60
    python benchmarks/physics_profiles.py --runs runs/sac_1 runs/planned_1

The sight-reader plays generated excerpts of 12 s that it never saw, and the first 30 s of the
pieces that judge a distillation, closed loop, in every profile. Differences are paired by excerpt.

With ``--runs`` the last models of runs play, each its own piece. A
single episode jumps by some hundredths, so each of several has a small noise on its actions.
Differences are paired by run, ± is their standard error.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import track

from sb3_piano.arrays import FloatArray
from sb3_piano.lab.distillation import DistillConfig
from sb3_piano.lab.distillation.rollout import hands_env
from sb3_piano.lab.music import Corpus
from sb3_piano.music import Score, load_score
from sb3_piano.players import HandModel
from sb3_piano.players.hand_model import SHIPPED
from sb3_piano.simulation import PHYSICS_PROFILES
from sb3_piano.threads import torch_computing
from sb3_piano.training import OpenPlayer
from sb3_piano.wrappers import HandActions

SEED = 77
"""Of a corpus that nothing was learnt from."""
LENGTH = 30.0
"""How much of a piece is played, s."""
EPISODES = 8
"""Episodes of each run."""
SCORES = ("f1", "onset_f1", "normalized_return")
REFERENCE = list(PHYSICS_PROFILES).index("reference")
NOISE = 0.003
"""Standard deviation of the noise on actions in [-1, 1]."""


def music(excerpts: int) -> list[Score]:
    """Return what is played."""
    corpus = Corpus(seed=SEED, n=max(excerpts, 1), sources={"generated": 1.0})
    pieces = [load_score(name) for name in DistillConfig().evaluation.pieces]
    return [corpus.fingered(index) for index in range(excerpts)] + [
        piece.excerpt(0.0, min(LENGTH, piece.duration)) for piece in pieces
    ]


def play(env: HandActions, model: HandModel, score: Score) -> list[float]:
    """Return F1, onset F1, normalized return and a control step's time without the network, s."""
    observation, _ = env.reset(seed=0, options={"score": score})
    spent, steps, over = 0.0, 0, False
    while not over:
        action = model.act(observation)
        start = time.perf_counter()
        observation, _, terminated, truncated, info = env.step(action)
        spent, steps, over = spent + time.perf_counter() - start, steps + 1, terminated or truncated
    return [*(info[name] for name in SCORES), spent / steps]


def play_run(run: str, physics: str) -> FloatArray:
    """Return F1, onset F1 and normalized return of each episode, and a control step's time, s."""
    with OpenPlayer.open(run, physics=physics) as player:
        piano, random = player.env, np.random.default_rng(SEED)
        step, times = piano.step, []

        def disturbed(action: npt.NDArray) -> tuple:
            noise = NOISE * random.standard_normal(np.shape(action))
            start = time.process_time()
            result = step(action + noise)
            times.append(time.process_time() - start)
            return result

        piano.step = disturbed
        played = [recording.metrics for recording in player.play(EPISODES)]
    return np.array([[*(one[name] for name in SCORES), np.mean(times)] for one in played])


def compare_runs(runs: list[str]) -> None:
    """Play each run in each profile, and print the means."""
    print(f"Means of {EPISODES} episodes; ± is the standard error.\n")
    print("| physics | run | F1 | onset F1 | return | speed |")
    print("|---|---|---:|---:|---:|---:|")
    means = []
    with torch_computing(1):
        for run in track(runs, description="Playing", console=Console(stderr=True)):
            found = np.array([play_run(run, name) for name in PHYSICS_PROFILES])
            means.append(found.mean(axis=1))
            error = found.std(axis=1, ddof=1) / EPISODES**0.5
            for name, mean, apart in zip(PHYSICS_PROFILES, means[-1], error, strict=True):
                cells = [f"{mean[k]:.3f} ± {apart[k]:.3f}" for k in range(len(SCORES))]
                speed = means[-1][REFERENCE, -1] / mean[-1]
                print(f"| {name} | {run} | {' | '.join(cells)} | {speed:.2f} |", flush=True)
    if len(runs) > 1:
        print(f"\nMeans over {len(runs)} runs, and what is less than the reference's.\n")
        summarize(np.array(means))


def summarize(means: FloatArray) -> None:
    """Print a table of (runs, profiles, scores and time), paired by run."""
    apart = means - means[:, [REFERENCE]]
    error = apart.std(axis=0, ddof=1) / len(means) ** 0.5
    mean, apart = means.mean(axis=0), apart.mean(axis=0)
    print("| physics | F1 |  | onset F1 |  | return |  | speed |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    for number, name in enumerate(PHYSICS_PROFILES):
        cells = [name]
        for column in range(len(SCORES)):
            cells.append(f"{mean[number, column]:.3f}")
            cells.append(f"{apart[number, column]:+.3f} ± {error[number, column]:.3f}")
        print(f"| {' | '.join(cells)} | {mean[REFERENCE, -1] / mean[number, -1]:.2f} |")


def main() -> None:
    """Read the command line, play and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--excerpts", type=int, default=60, metavar="N", help="default: 60")
    parser.add_argument("--runs", nargs="+", metavar="RUN", help="compare by these runs")
    arguments = parser.parse_args()
    if arguments.runs:
        compare_runs(arguments.runs)
        return
    scores, model = music(arguments.excerpts), HandModel.load(SHIPPED)
    envs = [hands_env(name) for name in PHYSICS_PROFILES]
    rows = []
    with torch_computing(1):
        # Profile after profile on each excerpt: what else runs here slows them down alike.
        for score in track(scores, description="Playing", console=Console(stderr=True)):
            rows.append([play(env, model, score) for env in envs])
    print(f"Means over {len(scores)} excerpts, and what is less than the reference's.\n")
    summarize(np.array(rows))


if __name__ == "__main__":
    main()
