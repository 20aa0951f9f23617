"""The cells of the paper's tables: one YAML file each, ``<algorithm>/<name>.yml``."""

from __future__ import annotations

import fnmatch
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training import RunConfig, RunFolder, load_config

HERE = Path(__file__).parent
RUNS = Path("runs/sac_vs_td3")
"""Where the runs are kept, unless said otherwise."""


@dataclass(frozen=True)
class Cell:
    """One trained model of the tables, such as ``td3/c_major_shift_3``."""

    path: Path
    """Its YAML file, in the form of RL Zoo."""

    @property
    def algo(self) -> str:
        """Name of the algorithm."""
        return self.path.parent.name

    @property
    def name(self) -> str:
        """What the command line calls it."""
        return f"{self.algo}/{self.path.stem}"

    @property
    def env_id(self) -> str:
        """The environment: the only entry of the file."""
        (env_id,) = self._content()
        return str(env_id)

    def config(self, seed: int, **changed: Any) -> RunConfig:
        """Return the settings of a run from a seed, ``changed`` where they are not the paper's."""
        return load_config(self.algo, self.env_id, self.path, seed=seed, **changed)

    def run_folder(self, runs: Path, seed: int) -> Path:
        """Return where the run from a seed is kept."""
        return runs / self.algo / f"{self.path.stem}_seed_{seed}"

    def evaluated_runs(self, runs: Path) -> list[RunFolder]:
        """Return the runs, from all seeds, that were evaluated at the end of their training."""
        found = (RunFolder(path) for path in (runs / self.algo).glob(f"{self.path.stem}_seed_*"))
        return [run for run in found if _is_whole(run)]

    def _content(self) -> dict[str, Any]:
        content: dict[str, Any] = yaml.safe_load(self.path.read_text(encoding="utf-8"))
        return content


def _is_whole(run: RunFolder) -> bool:
    file = run.evaluation_dir / "metrics.json"
    if not file.is_file():
        return False
    judged = json.loads(file.read_text(encoding="utf-8"))["num_timesteps"]
    return bool(judged >= run.read_config().n_timesteps)


def find_cells(patterns: Sequence[str] = ("*",)) -> list[Cell]:
    """Return the cells whose names match one of the patterns, in the order of the patterns.

    Raises:
        ConfigError: If nothing matches a pattern.
    """
    known = {cell.name: cell for cell in map(Cell, sorted(HERE.glob("*/*.yml")))}
    found: dict[str, Cell] = {}
    for pattern in patterns:
        names = fnmatch.filter(known, pattern)
        if not names:
            raise ConfigError(
                f"No cell is called {pattern!r}.{near_names(pattern, known)} Expected one of "
                f"{', '.join(known)}, or a pattern such as 'td3/*'."
            )
        found.update({name: known[name] for name in names})
    return list(found.values())
