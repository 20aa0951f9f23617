"""A progress bar on the terminal while a benchmark runs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from rich.console import Console
from rich.progress import Progress, TaskID

from sb3_piano.bench.rounds import Tick


@contextlib.contextmanager
def progress_bar() -> Iterator[Tick]:
    """Show a bar for each part on standard error, as long as the context lasts."""
    progress = Progress(console=Console(stderr=True))
    tasks: dict[str, TaskID] = {}

    def tick(part: str, done: int, laps: int) -> None:
        if not tasks:
            progress.start()  # not before: without a task it would leave an empty line
        if part not in tasks:
            tasks[part] = progress.add_task(part, total=laps)
        progress.update(tasks[part], completed=done)

    try:
        yield tick
    finally:
        if tasks:
            progress.stop()
