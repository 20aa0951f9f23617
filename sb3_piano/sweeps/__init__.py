"""Sweeps: many runs of a grid of pieces, algorithms, settings and seeds, on one machine or many."""

from sb3_piano.sweeps.cells import CellJob, CellResult, finish_cells
from sb3_piano.sweeps.config import SweepConfig, load_sweep
from sb3_piano.sweeps.sweep import SweepResult, sweep, sweep_status

__all__ = [
    "CellJob",
    "CellResult",
    "SweepConfig",
    "SweepResult",
    "finish_cells",
    "load_sweep",
    "sweep",
    "sweep_status",
]
