"""Whether the fast physics plays the same music as the exact one, also when playing is imperfect.

    python benchmarks/equal_music.py --episodes 16

Replays the recorded good performances of the tests open loop, with noise added to the actions, and
compares F1 and return on both profiles. For scale, one column tells what becomes of the exact
physics alone when every action is off by a ten-millionth.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import track
from rich.table import Table

from sb3_piano.envs import PianoEnv

FloatArray = npt.NDArray[np.float64]

PERFORMANCES = Path(__file__).parents[1] / "tests" / "data" / "reference"
SPREADS = (0.01, 0.03, 0.1)
"""Standard deviations of the noise, of actions in [-1, 1]."""
TINY = 1e-7


def noise(rng: np.random.Generator, steps: int, size: int) -> FloatArray:
    """Return noise of standard deviation 1 that changes over some five steps, (steps, size)."""
    rows, row = [], rng.normal(size=size)
    for _ in range(steps):
        row = 0.8 * row + 0.6 * rng.normal(size=size)
        rows.append(row)
    return np.array(rows)


def play(env: PianoEnv, actions: FloatArray) -> tuple[float, float]:
    """Return F1 and return of an episode."""
    env.reset(seed=0)
    total, truncated, step = 0.0, False, 0
    while not truncated:
        _, reward, _, truncated, info = env.step(np.clip(actions[step], -1.0, 1.0))
        total, step = total + float(reward), step + 1
    return info["f1"], total


def measure(path: Path, spread: float, episodes: int) -> FloatArray:
    """Return F1 and return on the exact, the fast and the exact physics disturbed, (n, 3, 2)."""
    piece = path.stem.split("_")[1]
    with np.load(path) as content:
        recorded, buffer_time = content["action"], float(content["initial_buffer_time"])
    options = {"reduced_action_space": False, "initial_buffer_time": buffer_time}
    reference = PianoEnv(piece, **options)
    fast = PianoEnv(piece, physics="fast", **options)
    rows = []
    for episode in range(episodes):
        actions = recorded.astype(np.float64)
        disturbed = noise(np.random.default_rng(episode), *actions[:, :-1].shape)
        actions[:, :-1] += spread * disturbed
        rows.append(
            [play(reference, actions), play(fast, actions), play(reference, actions + TINY)]
        )
    return np.array(rows)


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--episodes", type=int, default=16, help="for each piece and noise")
    arguments = parser.parse_args()
    table = Table(title="Mean over pieces and episodes; ± is the standard error")
    for heading in ("noise", "F1 exact", "fast - exact", "exact disturbed - exact", "return"):
        table.add_column(heading, justify="right")
    for spread in track(SPREADS, description="Playing"):
        paths = sorted(PERFORMANCES.glob("performance_*.npz"))
        rows = np.concatenate([measure(path, spread, arguments.episodes) for path in paths])
        f1, total = rows[..., 0], rows[..., 1]
        cells = [f"{spread}", f"{f1[:, 0].mean():.3f}"]
        for column in (1, 2):
            change = f1[:, column] - f1[:, 0]
            cells.append(f"{change.mean():+.4f} ± {change.std() / len(change) ** 0.5:.4f}")
        table.add_row(*cells, f"{np.mean(total[:, 1] / total[:, 0] - 1):+.2%}")
    Console().print(table)


if __name__ == "__main__":
    main()
