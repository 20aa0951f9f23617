"""The cells of RoboVirtuoso's tables: one YAML file each, ``<table>/<name>.yml``.

``study.yml`` says which pieces each of them is trained on and from which cell it starts.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from sb3_piano.callbacks import Checkpoint
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import ConfigError, RunError, near_names
from sb3_piano.training import RunConfig, RunFolder, load_config, load_start

HERE = Path(__file__).parent
RUNS = Path("runs/robovirtuoso")
"""Where the runs are kept, unless said otherwise."""

SIGHT_READER = "sight-reader"
"""Player, and folder among the runs, of what plays the unseen pieces beside the cells."""

STUDY: dict[str, Any] = yaml.safe_load((HERE / "study.yml").read_text(encoding="utf-8"))
"""Content of ``study.yml``."""

Changes = dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """A way to train of the tables, such as ``table_1/from_one_scale``."""

    name: str

    @property
    def file(self) -> Path:
        """Its YAML file, in the form of RL Zoo."""
        return HERE / f"{self.name}.yml"

    @property
    def start(self) -> Cell | None:
        """The cell whose networks it starts from, if any."""
        start = STUDY["cells"][self.name].get("start")
        return None if start is None else Cell(start)

    @property
    def is_together(self) -> bool:
        """Whether it is trained on all its pieces together, and so judged on unseen ones, too."""
        return "together" in STUDY["cells"][self.name]

    @property
    def settings(self) -> RunConfig:
        """Settings of its trainings but for pieces, seed, and what they start from."""
        return load_config("sac", GENERAL_ID, self.file)

    def trainings(self, seeds: Sequence[int]) -> Iterator[Training]:
        """Yield its trainings: one on all its pieces together, or one on each."""
        study = STUDY["cells"][self.name]
        for seed in seeds:
            if self.is_together:
                yield Training(self, study["together"], seed)
            else:
                for piece in STUDY[study["each"]]:
                    yield Training(self, piece, seed)


@dataclass(frozen=True)
class Training:
    """A training of a cell: on a piece, or on several together, from a seed."""

    cell: Cell
    pieces: str
    """An entry of :func:`~sb3_piano.music.select_pieces`."""
    seed: int

    @property
    def folder(self) -> Path:
        """Where its run is kept, below the folder of all runs."""
        piece = "" if self.cell.is_together else f"{self.pieces}_"
        return Path(self.cell.name, f"{piece}seed_{self.seed}")

    @property
    def start(self) -> Training | None:
        """The training whose networks it starts from, of the same seed."""
        cell = self.cell.start
        return None if cell is None else next(iter(cell.trainings([self.seed])))

    def config(self, runs: Path, **changed: Any) -> RunConfig:
        """Return its settings, ``changed`` where they are not the cell's.

        Raises:
            RunError: If what it starts from is not trained to its end.
        """
        given = {"seed": self.seed, "pieces": self.pieces, **changed}
        if self.start is None:
            return load_config("sac", GENERAL_ID, self.cell.file, **given)
        start = RunFolder.open(runs / self.start.folder)
        saved, steps = Checkpoint.read(start.checkpoint_dir), start.read_config().n_timesteps
        done = 0 if saved is None else saved.num_timesteps
        if done < steps:
            raise RunError(
                f"{self.folder} starts from '{start.path}', which has {done} of its {steps} steps: "
                f"expected it to be trained before, as by run.py {self.start.cell.name} "
                f"--seeds {self.seed}."
            )
        return load_start(start.path, GENERAL_ID, self.cell.file, **given)


def find_cells(patterns: Sequence[str] = ("*",)) -> list[Cell]:
    """Return the cells whose names match one of the patterns, those first that others start from.

    Raises:
        ConfigError: If nothing matches a pattern.
    """
    known = list(STUDY["cells"])
    found: dict[str, None] = {}
    for pattern in patterns:
        names = fnmatch.filter(known, pattern)
        if not names:
            raise ConfigError(
                f"No cell is called {pattern!r}.{near_names(pattern, known)} Expected one of "
                f"{', '.join(known)}, or a pattern such as 'table_3/*'."
            )
        found.update(dict.fromkeys(names))
    return [Cell(name) for name in known if name in found]
