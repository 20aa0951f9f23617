"""What the package's speed claims rest on, measured in one run."""

from sb3_piano.bench.peer import PeerError
from sb3_piano.bench.progress import progress_bar
from sb3_piano.bench.report import Report, run_bench
from sb3_piano.bench.rows import Row
from sb3_piano.bench.settings import PARTS, BenchSettings
from sb3_piano.bench.table import render

__all__ = [
    "PARTS",
    "BenchSettings",
    "PeerError",
    "Report",
    "Row",
    "progress_bar",
    "render",
    "run_bench",
]
