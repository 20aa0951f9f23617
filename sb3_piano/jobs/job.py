"""Jobs: work in a folder that may end at any moment, and goes on from there."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from sb3_piano.exceptions import SB3PianoError, one_line
from sb3_piano.files import read_json, write_json
from sb3_piano.jobs.folders import SETTINGS, begin_or_go_on, is_empty
from sb3_piano.locks import LOCK_SUFFIX, hold

Work = Callable[[Any], Mapping[str, Any]]
"""Does a job, which it is called with, or the rest of it, and returns its result."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """Work in a folder of its own.

    The folder gets ``job.yml``, the settings, when the work begins, and ``result.json`` when it is
    done. A subclass may keep them elsewhere, and say how far it is.
    """

    kind: ClassVar[str] = "job"
    """What messages call it."""

    name: str
    """What it is called, unlike all others of the same work."""
    folder: Path
    """Where it is done, by a path that every process has."""
    work: Work
    """Does it, from wherever it stopped before; raises ``KeyboardInterrupt`` if it is interrupted.
    Other processes must be able to import it. The result has JSON's types."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """What it is, in YAML's types; a folder that was begun with other settings is refused."""
    needs: tuple[str, ...] = ()
    """Names of the jobs that have to be done before."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """What may differ from one call to the next, such as how often to save."""

    @property
    def settings_file(self) -> Path:
        """The file of the settings with which it was begun."""
        return self.folder / SETTINGS

    def has_begun(self) -> bool:
        """Return whether its settings were noted."""
        return self.settings_file.is_file()

    @property
    def result_file(self) -> Path:
        """The file of the result, which is written last."""
        return self.folder / "result.json"

    def result(self) -> Mapping[str, Any] | None:
        """Return what came of it, or ``None`` if it is not done.

        Raises:
            RunError: If the file is damaged.
        """
        return read_json(self.result_file, dict[str, Any], "delete it, and it is made again.")

    def begin(self) -> None:
        """Note the settings, if it has any, in a new folder, or compare them with those there.

        Raises:
            RunError: If they differ, or something else is in the folder.
        """
        if self.settings:
            begin_or_go_on(self.settings_file, f"{self.kind} {self.name!r}", self.settings)

    def progress(self) -> tuple[int, int] | None:
        """Return how much is done, and of how much, also while it is being done, if it knows."""
        return None

    def do(self) -> Mapping[str, Any]:
        """Do what is left to do, and return the result; a second process waits for the first."""
        with hold(self.folder.with_name(f".{self.folder.name}{LOCK_SUFFIX}")):
            found = self.result()
            if found is None:
                self.begin()
                try:
                    found = self.work(self)
                    write_json(self.result_file, found)
                except Exception:  # what has not begun may have other settings the next time
                    if self.folder.is_dir() and is_empty(self.folder):
                        shutil.rmtree(self.folder, ignore_errors=True)
                    raise
            return found


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a job, or how far it is."""

    job: Job
    result: Mapping[str, Any] | None = None
    """Its result, once it is done."""
    error: Exception | None = None
    """Why it failed, if it did."""

    @property
    def reason(self) -> str:
        """Why it failed, in a line; empty if it did not."""
        if self.error is None or isinstance(self.error, SB3PianoError):
            return str(self.error or "")
        return f"{type(self.error).__name__}: {one_line(self.error)}"

    @property
    def state(self) -> str:
        """``failed``, ``finished``, how far it is, or ``not begun``."""
        if self.error is not None:
            return "failed"
        if self.result is not None:
            return "finished"
        done = self.job.progress()
        if done is not None and done[0]:
            return f"{done[0]} of {done[1]} steps"
        return "begun" if self.job.has_begun() else "not begun"


def status(jobs: Iterable[Job]) -> list[Outcome]:
    """Return how far each job is by its folder, also while it is being done."""
    return [Outcome(job=job, result=job.result()) for job in jobs]
