"""Run folders on object storage: trained in a folder of the machine, kept where all reach them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import Checkpoint
from sb3_piano.exceptions import MissingPackageError
from sb3_piano.unfinished import scratch_folder

_POINTER = "current"
"""File that names the whole copy; it is written last."""
_COPY = "copy-"


def is_url(folder: str) -> bool:
    """Return whether a folder is a URL as of fsspec, such as ``s3://bucket/sweep``."""
    return "://" in folder


@dataclass
class Mirror:
    """A folder of this machine, and its copy elsewhere if it has one."""

    place: Path
    """The folder of this machine."""
    url: str | None = None
    """Where copies are kept; ``None`` if the folder itself is where it belongs."""
    _number: int = field(default=0, init=False)

    @property
    def callbacks(self) -> Sequence[BaseCallback]:
        """Callbacks of a training in this folder."""
        return [] if self.url is None else [_StoreCheckpoints(self)]

    def fetch(self) -> None:
        """Bring the newest whole copy here, if there is one."""
        if self.url is None:
            return
        fs, root = _filesystem(self.url)
        if not fs.exists(f"{root}/{_POINTER}"):
            return
        name = fs.cat_file(f"{root}/{_POINTER}").decode()
        self._number = int(name.rpartition("-")[2])
        fs.get(f"{root}/{name}/", f"{self.place}/", recursive=True)

    def store(self) -> None:
        """Copy the folder; former copies are there until this one is whole, then deleted."""
        if self.url is None:
            return
        fs, root = _filesystem(self.url)
        self._number += 1
        name = f"{_COPY}{self._number}"
        if fs.exists(f"{root}/{name}"):  # of a process that died
            fs.rm(f"{root}/{name}", recursive=True)
        fs.makedirs(f"{root}/{name}", exist_ok=True)
        fs.put(f"{self.place}/", f"{root}/{name}/", recursive=True)
        fs.pipe_file(f"{root}/{_POINTER}", name.encode())
        fs.invalidate_cache()
        for found in fs.ls(root, detail=False):  # also what a process that died did not delete
            number = Path(found).name.removeprefix(_COPY)
            if number.isdigit() and int(number) < self._number:
                fs.rm(found, recursive=True)


@contextlib.contextmanager
def mirrored(folder: str) -> Iterator[Mirror]:
    """Give the folder of this machine that stands for a folder, which may be a URL.

    Raises:
        MissingPackageError: If the package for that kind of URL is not installed.
    """
    if not is_url(folder):
        place = Path(folder)
        place.parent.mkdir(parents=True, exist_ok=True)
        yield Mirror(place)
        return
    with scratch_folder() as scratch:
        mirror = Mirror(Path(scratch, "run"), folder.rstrip("/"))
        mirror.fetch()
        yield mirror


@contextlib.contextmanager
def glance(folder: str, files: Sequence[str]) -> Iterator[Path]:
    """Give a folder with some files of a folder, which may be a URL, as far as they are there.

    Raises:
        MissingPackageError: If the package for that kind of URL is not installed.
    """
    if not is_url(folder):
        yield Path(folder)
        return
    fs, root = _filesystem(folder)
    with scratch_folder() as scratch:
        with contextlib.suppress(FileNotFoundError):
            name = fs.cat_file(f"{root}/{_POINTER}").decode()
            for file in files:
                place = Path(scratch, file)
                place.parent.mkdir(exist_ok=True)
                place.write_bytes(fs.cat_file(f"{root}/{name}/{file}"))
        yield Path(scratch)


def _filesystem(url: str) -> tuple[Any, str]:
    import fsspec

    try:
        fs, root = fsspec.core.url_to_fs(url)
    except ImportError as error:
        raise MissingPackageError(f"'{url}' needs another package: {error}") from error
    return fs, root


class _StoreCheckpoints(BaseCallback):
    """Copy the folder whenever it has a new checkpoint."""

    def __init__(self, mirror: Mirror) -> None:
        super().__init__()
        self._mirror, self._stored = mirror, 0

    def _on_rollout_start(self) -> None:
        saved = Checkpoint.read(self._mirror.place / "checkpoint")
        if saved is not None and saved.num_timesteps != self._stored:
            self._stored = saved.num_timesteps
            self._mirror.store()

    def _on_step(self) -> bool:
        return True
