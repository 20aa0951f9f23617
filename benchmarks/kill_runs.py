"""Losses where processes are killed: trainings, and studies in a journal or in PostgreSQL.

    python benchmarks/kill_runs.py train --kills 20
    python benchmarks/kill_runs.py tune --kills 20
    python benchmarks/kill_runs.py tune --kills 20 --storage postgresql

The real command runs in processes of its own, in a temporary folder. Each gets SIGKILL at a random
moment, every other training while it writes a file; where nothing goes on by itself, the same
command, or ``--resume``, is given again. Of a training the steps are counted that were done and are
in no checkpoint; at most one interval between two checkpoints may be lost. Of a study the parent, a
worker or all of them are killed; every trial that was finished has to stay as it was, and all
settings that were drawn have to be tried to the end. Prints a table in Markdown and fails if
anything is lost. ``--storage`` takes a database's URL, or ``postgresql`` for a server that is
started here.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import optuna
import yaml
from optuna.trial import FrozenTrial, TrialState
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import Checkpoint
from sb3_piano.training import RunFolder
from sb3_piano.tuning import StudyFolder
from sb3_piano.tuning.storage import open_storage
from sb3_piano.tuning.trials import counting

sys.path.append(str(Path(__file__).parents[1] / "tests" / "tuning"))
from postgresql_server import postgresql_server
from small_study import ENTRY, ENV_ID

INTERVAL = 25
"""Environment steps between two checkpoints."""
ENDLESS = 100_000
"""More steps, or trials, than there is time for."""
PATIENCE = 300.0
"""The longest that something may take that should happen, s."""


class NoteSteps(BaseCallback):
    """Keep in a file how many steps are done, for who looks at it when this process is killed."""

    def __init__(self, file: str) -> None:
        super().__init__()
        self._file = os.open(file, os.O_WRONLY | os.O_CREAT)

    def _on_step(self) -> bool:
        os.pwrite(self._file, b"%9d" % self.num_timesteps, 0)
        return True


class Command:
    """An ``sb3-piano`` command that is given again whenever its process is gone."""

    def __init__(self, folder: Path, log: Path) -> None:
        self._folder = folder
        self._log = log
        self.process: subprocess.Popen[bytes] | None = None

    def give(self, *arguments: str) -> None:
        """Start a process."""
        here = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "sb3_piano.cli", *arguments, "--no-progress"],
                cwd=self._folder,
                env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": here},
                stdout=log,
                stderr=log,
            )

    def until(self, happened: Callable[[], object], every: float = 0.02) -> None:
        """Wait for something to happen while the process runs."""
        deadline = time.monotonic() + PATIENCE
        while not happened():
            if not self.runs or time.monotonic() > deadline:
                self.kill()
                raise SystemExit(f"The command does not go on: {self._log.read_text()[-3000:]}")
            time.sleep(every)

    @property
    def runs(self) -> bool:
        """Whether the process lives."""
        return self.process is not None and self.process.poll() is None

    def kill(self) -> None:
        """Kill the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def finish(self, *arguments: str) -> bool:
        """Give the command and return whether it succeeded."""
        self.give(*arguments)
        assert self.process is not None, "it was just started"
        return self.process.wait() == 0


def kill_trainings(place: Path, kills: int, seconds: float, rng: random.Random) -> list[str]:
    """Kill a training again and again; return a row of the table."""
    steps = place / "steps"
    note = {"kill_runs.NoteSteps": {"file": str(steps)}}
    (place / "small.yml").write_text(yaml.safe_dump({"default": {**ENTRY, "callback": note}}))
    run = RunFolder(place / "run")
    command = Command(place, place / "log")
    lost, while_saving, saved = [], 0, 0
    for number in range(kills):
        steps.unlink(missing_ok=True)
        for left in run.path.rglob("*.partial"):  # by the kill before
            left.unlink()
        every = ("--checkpoint-every", str(INTERVAL), "--steps", str(ENDLESS))
        if number == 0:
            new = ("--env", ENV_ID, "--config", "small.yml", "--run", "run", "--seed", "0")
            command.give("train", *new, *every)
        else:
            command.give("train", "--resume", "run", *every)
        command.until(lambda: steps.exists() and steps.read_text().strip())
        command.until(lambda before=saved: _steps_saved(run) > before)
        time.sleep(rng.uniform(0, seconds))
        if number % 2:  # the next moment at which a file is being written
            command.until(lambda: any(run.path.rglob("*.partial")), every=0.0)
        command.kill()
        saved = _steps_saved(run)
        lost.append(int(steps.read_text()) - saved)
        while_saving += any(run.path.rglob("*.partial"))
    whole = command.finish("train", "--resume", "run", "--steps", str(saved + INTERVAL))
    at_most = max(lost)
    if at_most > INTERVAL or not whole:
        raise SystemExit(f"Lost {lost} steps, resumed: {whole}")
    lost_text = f"at most {at_most} of {INTERVAL} steps"
    return ["training", str(kills), f"{while_saving} while saving", lost_text, "yes"]


def _steps_saved(run: RunFolder) -> int:
    saved = Checkpoint.read(run.checkpoint_dir)  # raises if one of its files is missing
    return 0 if saved is None else saved.num_timesteps


def kill_studies(
    place: Path, kills: int, seconds: float, rng: random.Random, url: str | None
) -> list[str]:
    """Kill a study's processes again and again; return a row of the table."""
    (place / "small.yml").write_text(yaml.safe_dump({"default": ENTRY}))
    (place / "space.yml").write_text(yaml.safe_dump({"gamma": {"discount": [0.6, 0.9]}}))
    name = f"killed-{time.time_ns()}"
    arguments = ["tune", "--env", ENV_ID, "--config", "small.yml", "--space", "space.yml"]
    arguments += ["--steps", "40", "--evaluations", "2", "--pruner", "none", "--name", name]
    arguments += ["--workers", "2", *(() if url is None else ("--storage", url))]
    folder = StudyFolder(place / "studies" / name)
    command = Command(place, place / "log")
    killed = dict.fromkeys(("parent", "worker", "all"), 0)
    finished: dict[int, FrozenTrial] = {}
    for _ in range(kills):
        if not command.runs:
            command.give(*arguments, "--trials", str(ENDLESS))
        # Settings whose worker was killed four times count as failed: some trials have to end.
        before = _judged(folder)
        command.until(lambda before=before: _judged(folder) > before and _workers(folder))
        time.sleep(rng.uniform(0, seconds))
        victim = rng.choice(list(killed))
        killed[victim] += 1
        workers = _workers(folder)
        for worker in {"parent": [], "worker": workers[:1], "all": workers}[victim]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(worker, signal.SIGKILL)
        if victim != "worker":
            command.kill()
        trials = _study(name, folder, url).get_trials()
        finished |= {trial.number: trial for trial in trials if _is_complete(trial)}
    command.kill()
    deadline = time.monotonic() + PATIENCE
    while _workers(folder):
        if time.monotonic() > deadline:
            raise SystemExit(f"Workers go on without a parent: {_workers(folder)}")
        time.sleep(0.1)
    so_far = len(counting(_study(name, folder, url)))
    whole = command.finish(*arguments, "--trials", str(so_far + 2))
    trials = _study(name, folder, url).get_trials()
    tried = [trial.params for trial in trials if _is_complete(trial)]
    lost = [trial.number for trial in trials if trial.params and trial.params not in tried]
    changed = [number for number, trial in finished.items() if trials[number] != trial]
    if lost or changed or not whole:
        for trial in trials:
            print(trial, file=sys.stderr)
        raise SystemExit(f"Lost trials {lost}, changed {changed}, went on: {whole}")
    kinds = ", ".join(f"{count} {victim}" for victim, count in killed.items())
    what = f"study in {'its journal' if url is None else 'PostgreSQL'}"
    return [what, str(kills), kinds, f"0 of {len(tried)} trials", "yes"]


def _is_complete(trial: FrozenTrial) -> bool:
    return trial.state is TrialState.COMPLETE


def _judged(folder: StudyFolder) -> int:
    """Return how many trials have trained and judged their model."""
    return len(list(folder.path.glob("trials/*/*/evaluation/metrics.json")))


def _workers(folder: StudyFolder) -> list[int]:
    """Return the process ids of the workers that live; the names of their logs have them."""
    ids = [int(log.stem.rpartition("-")[2]) for log in folder.workers_dir.glob("*.log")]
    commands = {pid: Path(f"/proc/{pid}/cmdline") for pid in ids}
    return [
        pid for pid, file in commands.items() if file.exists() and b"multiprocessing" in _read(file)
    ]


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError:  # the process has just ended
        return b""


def _study(name: str, folder: StudyFolder, url: str | None) -> optuna.Study:
    return optuna.load_study(study_name=name, storage=open_storage(url, folder))


@contextlib.contextmanager
def _storage(text: str | None) -> Iterator[str | None]:
    if text != "postgresql":
        yield text
        return
    with postgresql_server() as url:
        yield url


def main(argv: Sequence[str] | None = None) -> None:
    """Kill, and print the row of the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("what", choices=("train", "tune"))
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=3.0, help="at most, after it goes on")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--storage", help="a database's URL, or postgresql; default: a journal")
    arguments = parser.parse_args(argv)
    rng = random.Random(arguments.seed)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with tempfile.TemporaryDirectory() as place:
        if arguments.what == "train":
            row = kill_trainings(Path(place), arguments.kills, arguments.seconds, rng)
        else:
            with _storage(arguments.storage) as url:
                row = kill_studies(Path(place), arguments.kills, arguments.seconds, rng, url)
    print("| what | kills | of them | lost | goes on |\n|---|---|---|---|---|")
    print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    main()
