"""Jobs: resumable work, each in a folder of its own."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import SB3PianoError, no_memory, one_line
from sb3_piano.files import read_json, write_json
from sb3_piano.jobs.folders import SETTINGS, begin_or_resume, is_empty
from sb3_piano.locks import LOCK_SUFFIX, hold

Work = Callable[[Any], Mapping[str, Any]]
"""Function that does a job, or the rest of it, and returns its result."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """Resumable work in a folder of its own.

    The folder gets ``job.yml``, the settings, when the work begins, and ``result.json`` when it is
    done. A subclass may use other files, and may report its progress.
    """

    name: str
    """Name, unique among the jobs of a call."""
    folder: Path
    """Folder of the job, by a path that is valid in every process."""
    work: Work
    """Function that does the job, or resumes it; raises ``KeyboardInterrupt`` if it is interrupted.
    Other processes must be able to import it. The result has JSON types."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings in YAML types; a folder with other settings is refused."""
    needs: tuple[str, ...] = ()
    """Names of the jobs that must finish first."""

    @property
    def settings_file(self) -> Path:
        """File of the job's settings."""
        return self.folder / SETTINGS

    def has_begun(self) -> bool:
        """Return whether the settings file exists."""
        return self.settings_file.is_file()

    @property
    def result_file(self) -> Path:
        """File of the result, which is written last."""
        return self.folder / "result.json"

    def result(self) -> Mapping[str, Any] | None:
        """Return the result, or ``None`` if the job is not finished; refuse a damaged file."""
        return read_json(self.result_file, dict[str, Any], "delete it, and it is made again.")

    def begin(self) -> None:
        """Write the settings, if any, into a new folder; refuse other settings or other files."""
        if self.settings:
            begin_or_resume(self.settings_file, f"job {self.name!r}", self.settings)

    def progress(self) -> tuple[int, int] | None:
        """Return the amounts done and in total, also of a running job; ``None`` if unknown."""
        return None

    def do(self) -> Mapping[str, Any]:
        """Do the rest of the job and return its result; a second process waits for the first."""
        with hold(self.folder.with_name(f".{self.folder.name}{LOCK_SUFFIX}")):
            found = self.result()
            if found is None:
                self.begin()
                try:
                    found = self.work(self)
                    write_json(self.result_file, found)
                except Exception:  # a job without files may have other settings next time
                    if self.folder.is_dir() and is_empty(self.folder):
                        shutil.rmtree(self.folder, ignore_errors=True)
                    raise
            return found


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """State of a job: its result, its error, or neither."""

    job: Job
    result: Mapping[str, Any] | None = None
    """Result of a finished job."""
    error: Exception | None = None
    """Exception of a failed job."""

    @property
    def reason(self) -> str:
        """One-line reason of a failure; empty if it did not fail."""
        return "" if self.error is None else reason_of(self.error)

    @property
    def state(self) -> str:
        """``failed``, ``finished``, the steps done, ``begun`` or ``not begun``."""
        if self.error is not None:
            return "failed"
        if self.result is not None:
            return "finished"
        done = self.job.progress()
        if done is not None and done[0]:
            return f"{done[0]} of {done[1]} steps"
        return "begun" if self.job.has_begun() else "not begun"


def reason_of(error: Exception) -> str:
    """Return the reason of a failure in one line."""
    reason = one_line(error)
    if not isinstance(error, SB3PianoError) and str(error):
        reason = f"{type(error).__name__}: {reason}"
    return f"out of memory: {reason}" if no_memory(error) else reason


def status(jobs: Iterable[Job]) -> list[Outcome]:
    """Read the state of each job from its folder, also of running jobs."""
    return [Outcome(job=job, result=job.result()) for job in jobs]
