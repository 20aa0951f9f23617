"""What a learned policy makes of each physics profile, and what a control step takes there.

    python benchmarks/physics_profiles.py --excerpts 60
    python benchmarks/physics_profiles.py --runs runs/sac_1 runs/sac_2

The sight-reader plays generated excerpts of 12 s that it never saw, and the first 30 s of the
pieces that judge a distillation, closed loop, in every profile. Differences are paired by excerpt.

With ``--runs`` the last models of runs play, each its own piece. A single episode jumps by some
hundredths, so each of several has a small noise on its actions.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import track

from sb3_piano.arrays import FloatArray
from sb3_piano.distillation import DistillConfig
from sb3_piano.distillation.rollout import hands_env
from sb3_piano.music import Corpus, Score, load_score
from sb3_piano.players import HandModel
from sb3_piano.players.hand_model import SHIPPED
from sb3_piano.simulation import PHYSICS_PROFILES
from sb3_piano.threads import torch_threads
from sb3_piano.training import SavedPlayer
from sb3_piano.wrappers import HandActions

SEED = 77
"""Of a corpus that nothing was learnt from."""
LENGTH = 30.0
"""How much of a piece is played, s."""
EPISODES = 8
"""Episodes of each run."""
NOISE = 0.003
"""Standard deviation of the noise on actions in [-1, 1]."""


def music(excerpts: int) -> list[Score]:
    """Return what is played."""
    corpus = Corpus(seed=SEED, n=max(excerpts, 1), sources={"generated": 1.0})
    pieces = [load_score(name) for name in DistillConfig().evaluation.pieces]
    return [corpus.fingered(index) for index in range(excerpts)] + [
        piece.excerpt(0.0, min(LENGTH, piece.duration)) for piece in pieces
    ]


def play(env: HandActions, model: HandModel, score: Score) -> tuple[float, float, float]:
    """Return F1, onset F1 and the mean time of a control step without the network, s."""
    observation, _ = env.reset(seed=0, options={"score": score})
    spent, steps, over = 0.0, 0, False
    while not over:
        action = model.act(observation)
        start = time.perf_counter()
        observation, _, terminated, truncated, info = env.step(action)
        spent, steps, over = spent + time.perf_counter() - start, steps + 1, terminated or truncated
    return info["f1"], info["onset_f1"], spent / steps


def play_run(run: str, physics: str) -> FloatArray:
    """Return F1 and onset F1 of each episode of a run, and a control step's mean time, s."""
    with SavedPlayer.open(run, physics=physics) as player:
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
    return np.array([(one["f1"], one["onset_f1"], np.mean(times)) for one in played])


def compare_runs(runs: list[str]) -> None:
    """Play each run in each profile, and print the means."""
    print(f"Means of {EPISODES} episodes; ± is the standard error.\n")
    print("| physics | run | F1 | onset F1 | speed |")
    print("|---|---|---:|---:|---:|")
    with torch_threads(1):
        for run in runs:
            found = {name: play_run(run, name) for name in PHYSICS_PROFILES}
            for name, rows in found.items():
                mean = rows.mean(axis=0)
                error = rows.std(axis=0, ddof=1) / EPISODES**0.5
                speed = found["reference"][:, 2].mean() / mean[2]
                scores = [f"{mean[column]:.3f} ± {error[column]:.3f}" for column in (0, 1)]
                print(f"| {name} | {run} | {' | '.join(scores)} | {speed:.2f} |", flush=True)


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
    envs = {name: hands_env(name) for name in PHYSICS_PROFILES}
    rows = []
    with torch_threads(1):
        # Profile after profile on each excerpt: what else runs here slows them down alike.
        for score in track(scores, description="Playing", console=Console(stderr=True)):
            rows.append([play(env, model, score) for env in envs.values()])
    found: FloatArray = np.array(rows)  # (scores, profiles, 3)
    reference = list(envs).index("reference")
    change = found - found[:, [reference]]
    error = change.std(axis=0) / len(scores) ** 0.5
    mean, apart = found.mean(axis=0), change.mean(axis=0)
    print(f"Means over {len(scores)} excerpts; ± is the standard error.\n")
    print("| physics | F1 | less the reference's | onset F1 | less the reference's | speed |")
    print("|---|---:|---:|---:|---:|---:|")
    for number, name in enumerate(envs):
        cells = [name]
        for column in (0, 1):
            cells.append(f"{mean[number, column]:.3f}")
            cells.append(f"{apart[number, column]:+.3f} ± {error[number, column]:.3f}")
        print(f"| {' | '.join(cells)} | {mean[reference, 2] / mean[number, 2]:.2f} |")


if __name__ == "__main__":
    main()
