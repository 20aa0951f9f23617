"""What evaluation wrote, read back."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sb3_piano.envs import PianoEnvConfig
from sb3_piano.exceptions import RunError
from sb3_piano.training.run_folder import RunFolder


@dataclass(frozen=True, kw_only=True)
class SavedEpisodes:
    """The episodes of one run on one piece."""

    piece: str
    """What was played."""
    physics: str
    """Name of the physics profile that it was played on."""
    training_seed: int | None
    """Seed of the training; ``None`` if the evaluation does not tell."""
    seeds: tuple[int, ...]
    """The seed from which each episode comes."""
    metrics: tuple[Mapping[str, float], ...]
    """Metrics of each episode, by name."""


def read_episodes(source: str | os.PathLike[str]) -> list[SavedEpisodes]:
    """Return the episodes that an evaluation wrote.

    Args:
        source: A JSON file of ``sb3-piano evaluate``, the folder of an evaluated run, or a folder
            that holds such folders.

    Raises:
        RunError: If there is nothing of the kind, or a file is damaged.
    """
    path = Path(source)
    if path.is_file():
        return _read_file(path)
    if not path.is_dir():
        raise RunError(
            f"There is no '{path}': expected a JSON file of 'sb3-piano evaluate --json', the "
            "folder of an evaluated run, or a folder of such runs."
        )
    runs = [RunFolder(path)]
    if not runs[0].config_file.is_file():
        runs = [RunFolder(config.parent) for config in sorted(path.glob("*/config.yml"))]
    if not runs:
        raise RunError(
            f"'{path}' is no run and holds none: expected a folder that 'sb3-piano train' made, or "
            "one in which such folders are."
        )
    return [saved for run in runs for saved in _read_run(run)]


def _read_run(run: RunFolder) -> list[SavedEpisodes]:
    file = run.evaluation_dir / "metrics.json"
    if not file.is_file():
        raise RunError(
            f"Run '{run.path}' has no evaluation: expected evaluation/metrics.json. To make it: "
            f"sb3-piano evaluate {run.path}"
        )
    return _read_file(file)


def _read_file(file: Path) -> list[SavedEpisodes]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        found = [_episodes(entry) for entry in content.get("evaluations", [content])]
    except OSError as error:
        raise RunError(
            f"'{file}' cannot be read: {error.strerror}. Expected a JSON file."
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RunError(
            f"'{file}' holds no evaluation ({type(error).__name__}: {error}): expected a file that "
            "'sb3-piano evaluate' of this version wrote."
        ) from error
    if not found:
        raise RunError(f"'{file}' holds no evaluation: no run could be evaluated then.")
    return found


def _episodes(entry: Mapping[str, Any]) -> SavedEpisodes:
    training_seed = entry.get("training_seed")
    saved = SavedEpisodes(
        piece=str(entry["piece"]),
        physics=str(entry.get("env_kwargs", {}).get("physics", PianoEnvConfig.physics)),
        training_seed=None if training_seed is None else int(training_seed),
        seeds=tuple(int(seed) for seed in entry["episode_seeds"]),
        metrics=tuple(
            {name: float(value) for name, value in metrics.items()} for metrics in entry["episodes"]
        ),
    )
    if not saved.metrics or len(saved.seeds) != len(saved.metrics):
        raise ValueError(f"{len(saved.metrics)} episodes with {len(saved.seeds)} seeds")
    return saved
