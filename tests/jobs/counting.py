"""Jobs that count, slowly, and a program that does some of them: to be killed at any moment."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from sb3_piano.exceptions import ConfigError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Job, finish

STEPS = 60


@dataclass(frozen=True, kw_only=True)
class Counting(Job):
    """A job that counts up to its ``steps``, with a pause of some seconds before each."""

    pause: float = 0.01


def count(job: Counting) -> dict[str, int]:
    """Count to the end from where it was saved last; who counts is noted in a log."""
    saved = job.folder / "saved"
    done = int(saved.read_text()) if saved.exists() else 0
    with (job.folder.parent / "log").open("a") as log:
        log.write(f"{job.name} {done} {os.getpid()}\n")
    with stop_on_signal() as request:
        while done < job.settings["steps"]:
            time.sleep(job.pause)
            done += 1
            if done % 5 == 0 or request.made:
                saved.write_text(str(done))
            if request.made:
                raise KeyboardInterrupt
    return {"steps": done}


def refuse(job: Job) -> dict[str, int]:
    """Fail."""
    raise ConfigError(f"steps is {job.settings['steps']}: expected fewer.")


def die(job: Job) -> dict[str, int]:
    """Kill this process the first time."""
    if not (job.folder / "died").exists():
        (job.folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return count(job)


def jobs_in(folder: Path, work=count, steps: int = STEPS, pause: float = 0.01) -> list[Job]:
    """Return four jobs: two, one that needs the first of them, and one that needs that."""
    needs = {"a": (), "b": (), "c": ("a",), "d": ("c",)}
    return [
        Counting(
            name=name,
            folder=folder / name,
            work=work if name == "a" else count,
            settings={"steps": steps, "of": {"name": name}},
            needs=needs[name],
            pause=pause,
        )
        for name in needs
    ]


def log(folder: Path) -> list[tuple[str, int, int]]:
    """Return who counted: the job, from where on, and in which process."""
    file = folder / "log"
    lines = file.read_text().splitlines() if file.exists() else []
    return [(name, int(done), int(pid)) for name, done, pid in map(str.split, lines)]


def main(folder: Path) -> int:
    """Do the jobs in two processes; return the status of a command."""
    try:
        outcomes = finish(jobs_in(folder), workers=2)
    except KeyboardInterrupt:
        return 130
    for outcome in outcomes:
        print(outcome.job.name, outcome.state, outcome.reason, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.argv[1])))
