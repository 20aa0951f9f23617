"""Hanon or nothing before a piece, with the finger labels shown or hidden, paid for or not.

    python examples/curriculum/grid.py                      # all cells, seeds 0 to 2
    python examples/curriculum/grid.py --fingering 0 --seeds 0

The grid of section 4 of "Curriculum Strategies for Bimanual Dexterous Piano Playing in
RoboPianist", at a size for one core: 100,000 steps of each cell, five minutes, on the right hand's
42 notes of the Pathétique's rondo as they are written. What starts from Hanon had up to 120,000
steps of practice.yml before, with the labels shown and paid for. What is finished is kept: the same
command goes on after Ctrl-C or a crash.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.training import (
    Plugin,
    RunConfig,
    RunFolder,
    evaluate,
    load_config,
    load_curriculum,
    resume,
    run_curriculum,
    train,
)

HERE = Path(__file__).parent
PIECE = "RoboPianist-repertoire-PathetiqueRondo-v0"
METRICS = ("onset_f1", "f1", "effective_fingers")


def main() -> int:
    """Train what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="default: 0 1 2")
    add("--fingering", nargs="+", type=float, default=[0.0, 1.0], metavar="WEIGHT")
    add("--steps", type=int, metavar="N", help="of each stage and cell; default: theirs")
    add("--runs", type=Path, default=Path("runs/curriculum/grid"), metavar="DIR")
    arguments = parser.parse_args()
    print("| before | labels | weight | onset F1 | F1 | fingers |")
    print("| --- | --- | --- | --- | --- | --- |", flush=True)
    cells = itertools.product(("nothing", "Hanon"), ("shown", "hidden"), arguments.fingering)
    try:
        for before, labels, weight in cells:
            name = f"{before}_{labels}_{weight:g}"
            found = []
            for seed in arguments.seeds:
                start = None if before == "nothing" else practised(seed, arguments)
                folder = RunFolder(arguments.runs / f"{name}_seed_{seed}")
                finish(cell(labels, weight, start, seed, arguments.steps), folder)
                mean = evaluate(folder.path).mean
                found.append([mean[metric] for metric in METRICS])
            columns = " | ".join(map(over_seeds, zip(*found, strict=True)))
            print(f"| {before} | {labels} | {weight:g} | {columns} |", flush=True)
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on from here.")
        return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    return 0


def practised(seed: int, arguments: argparse.Namespace) -> Path:
    """Return the folder of the last stage of practice, after training what is missing of it."""
    curriculum = load_curriculum(HERE / "practice.yml")
    if arguments.steps is not None:
        stages = [
            dataclasses.replace(
                stage, until=None, settings={**stage.settings, "n_timesteps": arguments.steps}
            )
            for stage in curriculum.stages
        ]
        curriculum = dataclasses.replace(curriculum, stages=tuple(stages))
    result = run_curriculum(curriculum, arguments.runs / f"practice_seed_{seed}", seed=seed)
    if result.interrupted:
        raise KeyboardInterrupt
    return result.runs[-1].path


def cell(labels: str, weight: float, start: Path | None, seed: int, steps: int | None) -> RunConfig:
    """Return the settings of a cell."""
    options = {} if steps is None else {"n_timesteps": steps}
    config = load_config("sac", PIECE, HERE / "grid.yml", seed=seed, **options)
    wrappers = [
        dataclasses.replace(plugin, kwargs={"guidance": weight})
        if plugin.path.endswith("HandReward")
        else plugin
        for plugin in config.env_wrapper
    ]
    if labels == "hidden":
        wrappers.append(Plugin(path="sb3_piano.wrappers.HideFingering"))
    callbacks = list(config.callback)
    if start is not None:
        path = "sb3_piano.training.StartFromRun"
        callbacks.append(Plugin(path=path, kwargs={"run": str(start.absolute())}))
    changed: dict[str, Any] = {"env_wrapper": tuple(wrappers), "callback": tuple(callbacks)}
    return dataclasses.replace(config, **changed)


def finish(config: RunConfig, folder: RunFolder) -> None:
    """Bring a training to its end."""
    if folder.config_file.is_file():
        result = resume(folder.path, config.n_timesteps)
    else:
        result = train(config, folder.path)
    if result.interrupted:
        raise KeyboardInterrupt


def over_seeds(values: Sequence[float]) -> str:
    """Return the mean over the seeds, and the least and the greatest of them."""
    digits = 1 if max(values) > 2 else 3
    if len(values) == 1:
        return f"{values[0]:.{digits}f}"
    return f"{fmean(values):.{digits}f} [{min(values):.{digits}f}, {max(values):.{digits}f}]"


if __name__ == "__main__":
    raise SystemExit(main())
