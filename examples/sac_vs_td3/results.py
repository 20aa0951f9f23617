"""Figures of the runs of cells, those in run folders and those that are kept in results.json.

A run takes half an hour and its folder a hundred megabytes; what tables and figures need of it is
a kilobyte. ``table.py --keep`` adds it to results.json, from where it is read when the folder is
gone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from cells import HERE, Cell

from sb3_piano.files import write_text
from sb3_piano.training import RunFolder
from sb3_piano.training.evaluation.report import training_curves

KEPT = HERE / "results.json"

LOGGED = {
    "in training": "rollout/ep_rew_mean",  # with exploration, over the last 100 episodes
    "Q": "train/q_value",
    "actor loss": "train/actor_loss",
    "critic loss": "train/critic_loss",
}
"""Columns that are the last values of curves in the training's log."""

_POINTS = 50


@dataclass(frozen=True)
class Result:
    """What one run came to."""

    columns: Mapping[str, float]
    """Its figures by the columns of the tables; not all need be there."""
    steps: list[int] = field(default_factory=list)
    """Environment steps of the points of its curve; empty if the curve is lost."""
    returns: list[float] = field(default_factory=list)
    """Return by control step of the training's last episodes then."""


def results_of(cell: Cell, runs: Path, kept: Path) -> dict[int, Result]:
    """Return the results of a cell by seed: of run folders, else those that are kept."""
    found = _read(kept).get(cell.name, {})
    for run in cell.evaluated_runs(runs):
        found[seed_of(run)] = _result(run)
    return dict(sorted(found.items()))


def keep(cells: list[Cell], runs: Path, kept: Path) -> int:
    """Add the results of run folders to a file, in place of those of the same cell and seed.

    Runs of other lengths than their cells' are left out.

    Returns:
        How many there are.
    """
    results, count = _read(kept), 0
    for cell in cells:
        for run in cell.evaluated_runs(runs):
            seed = seed_of(run)
            if run.read_config().n_timesteps == cell.config(seed).n_timesteps:
                results.setdefault(cell.name, {})[seed] = _result(run)
                count += 1
    rows = [
        f'  "{name}": {{\n'
        + ",\n".join(f'    "{s}": {json.dumps(asdict(r))}' for s, r in sorted(of_cell.items()))
        + "\n  }"
        for name, of_cell in sorted(results.items())
    ]
    write_text(kept, "{\n" + ",\n".join(rows) + "\n}\n")
    return count


def seed_of(run: RunFolder) -> int:
    """Return the seed of a cell's run, which ends the name of its folder."""
    return int(run.path.name.rpartition("_")[2])


def _read(kept: Path) -> dict[str, dict[int, Result]]:
    if not kept.is_file():
        return {}
    content = json.loads(kept.read_text(encoding="utf-8"))
    return {
        name: {int(seed): Result(**result) for seed, result in of_cell.items()}
        for name, of_cell in content.items()
    }


def _result(run: RunFolder) -> Result:
    evaluation = json.loads((run.evaluation_dir / "metrics.json").read_text(encoding="utf-8"))
    mean, resting = evaluation["mean"], evaluation["baseline"]
    curves = training_curves(run)
    logged = {name: float(curves[key].values[-1]) for name, key in LOGGED.items() if key in curves}
    columns = {
        "return": mean["return"],
        "resting hands": resting["return"],
        "return / step": mean["return"] / mean["length"],
        "F1": mean["f1"],
        "resting F1": resting["f1"],
        "onset F1": mean["onset_f1"],
        **logged,
    }
    total, length = curves["rollout/ep_rew_mean"], curves["rollout/ep_len_mean"]
    by_step = dict(zip(length.steps.tolist(), length.values.tolist(), strict=True))
    pairs = zip(total.steps.tolist(), total.values.tolist(), strict=True)
    points = [(step, value / by_step[step]) for step, value in pairs if step in by_step]
    points = points[:: -(-len(points) // _POINTS) or 1]
    return Result(
        {name: float(f"{value:.6g}") for name, value in columns.items()},
        [step for step, _ in points],
        [float(f"{value:.4g}") for _, value in points],
    )
