"""A worker: a child process that runs the trials it is sent, one after the other."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import platform
import signal
import sys
import threading
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any

import optuna
from optuna.trial import FixedTrial

from sb3_piano.interrupts import ctrl_c_ignored
from sb3_piano.tuning.objective import Objective
from sb3_piano.tuning.study import StudyConfig, StudyFolder

# What a worker says of its trial; the values that follow each, and the answer.
REPORT = "report"  # value, step; answered by whether the trial is to be pruned
NOTE = "note"  # name, value
COMPLETE = "complete"  # value
PRUNED = "pruned"
FAILED = "failed"


class Worker:
    """The parent's end of a worker, which ends with this process.

    Args:
        config: The study.
        folder: Its folder.
    """

    trial: optuna.Trial | None = None
    """The trial that it runs."""
    said: tuple[Any, ...] | None = None
    """Its last report, if that is not in the store yet."""

    def __init__(self, config: StudyConfig, folder: StudyFolder):
        context = multiprocessing.get_context("spawn")
        self.connection, end = context.Pipe()
        self._process = context.Process(target=_work, args=(end, config, folder), daemon=False)
        with ctrl_c_ignored():
            self._process.start()
        end.close()  # so that the worker's death is the end of what it says

    def begin(self, trial: optuna.Trial) -> None:
        """Let it run a trial."""
        self.trial = trial
        with contextlib.suppress(OSError):  # it has died, which its connection tells too
            self.connection.send((trial.number, trial.params))

    def kill(self) -> str:
        """End it at once, if it has not ended by itself; return how it ended."""
        self._process.kill()
        self._process.join()
        code = self._process.exitcode
        assert code is not None, "the process has ended"
        return f"signal {signal.Signals(-code).name}" if code < 0 else f"status {code}"


class _SentTrial(FixedTrial):
    """A trial whose settings were chosen in the parent, which is told how it does."""

    def __init__(self, connection: Connection, number: int, params: Mapping[str, Any]):
        super().__init__(dict(params), number)
        self._connection = connection
        self._is_over = False

    def report(self, value: float, step: int) -> None:
        self._connection.send((REPORT, value, step))
        self._is_over = self._connection.recv()

    def should_prune(self) -> bool:
        return self._is_over

    def set_user_attr(self, key: str, value: Any) -> None:
        self._connection.send((NOTE, key, value))


def _work(connection: Connection, config: StudyConfig, folder: StudyFolder) -> None:
    """Run the trials that come; the target of a process."""
    os.setpgrp()  # Ctrl-C on the terminal is for the parent, which kills its workers
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with (folder.workers_dir / f"{platform.node()}-{os.getpid()}.log").open("ab") as log:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
            os.dup2(log.fileno(), stream.fileno())
    objective = Objective(config, folder)
    while True:
        try:
            number, params = connection.recv()
        except EOFError:
            return
        connection.send(_end_of(objective, _SentTrial(connection, number, params)))
        gc.collect()  # models refer to themselves: their memory would pile up


def _end_of(objective: Objective, trial: FixedTrial) -> tuple[Any, ...]:
    """Run a trial and return what is to be said of its end."""
    try:
        return COMPLETE, objective(trial)
    except optuna.TrialPruned:
        return (PRUNED,)
    except Exception:
        sys.excepthook(*sys.exc_info())  # for the log; the reason is noted with the trial
        return (FAILED,)


def _end_with_parent() -> None:
    """End this process once the one that started it is gone, however it died."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "a worker is started by another process"
    parent.join()
    os._exit(1)
