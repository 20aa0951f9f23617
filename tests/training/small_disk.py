"""A disk of a few megabytes that a test can fill and write-protect."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from stable_baselines3.common.callbacks import BaseCallback


class SmallDisk:
    """A mounted disk.

    Args:
        path: Its folder.
    """

    def __init__(self, path: Path):
        self.path = path
        self._filler = path / "filler"

    def fill(self) -> None:
        """Write until there is no room left."""
        with contextlib.suppress(OSError), self._filler.open("ab", buffering=0) as file:
            while True:
                file.write(bytes(512))

    def make_room(self) -> None:
        """Undo :meth:`fill`."""
        self._filler.unlink()

    def protect(self) -> None:
        """Let nobody write any more."""
        subprocess.run(["mount", "-o", "remount,ro", str(self.path)], check=True)


@contextlib.contextmanager
def small_disk(path: Path) -> Iterator[SmallDisk]:
    """Mount a disk; skip the test where that is not allowed."""
    path.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(path)]
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("there is no mount")
    if done.returncode != 0:
        pytest.skip(f"no disk can be mounted: {done.stderr.strip()}")
    try:
        yield SmallDisk(path)
    finally:
        subprocess.run(["umount", "--lazy", str(path)], check=True)


class FillAt(BaseCallback):
    """Fill a disk after some steps.

    Args:
        path: The disk's folder.
        steps: When.
    """

    def __init__(self, path: str, steps: int):
        super().__init__()
        self._disk = SmallDisk(Path(path))
        self._steps = steps

    def _on_step(self) -> bool:
        if self.num_timesteps == self._steps:
            self._disk.fill()
        return True
