"""The store of a study that needs no server: Optuna's journal, a file that workers append to."""

from __future__ import annotations

import json
import os
from pathlib import Path

from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock

from sb3_piano.exceptions import RunError

_LOCK_GRACE_SECONDS = 30  # Optuna's own default; as long a lock stays that a killed process had


def open_journal(file: Path) -> JournalStorage:
    """Return the store in a file, which is made if need be.

    A last line that is not whole, as its writer was killed, is cut off.

    Raises:
        RunError: If the file cannot be made, read or written, or is damaged elsewhere.
    """
    # Optuna's lock is a link to the file. A relative one would point nowhere, and whoever found it
    # left over by a killed process would wait for ever.
    file = file.resolve()
    lock = _MendingLock(file)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        backend = JournalFileBackend(str(file), lock_obj=lock)
        lock.acquire()
        try:
            _check_lines(file)
        finally:
            lock.release()
        return JournalStorage(backend)
    except OSError as error:
        raise RunError(
            f"'{file}' cannot be read and written: {error.strerror}. Expected a place in which "
            "files can be made."
        ) from error
    except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError):
        raise RunError(f"'{file}' is damaged: expected a journal of Optuna.") from None


class _MendingLock(JournalFileSymlinkLock):
    """Optuna's lock of a journal, whose holder finds only whole lines in it.

    If a worker is killed in the middle of its writing, the next line would be appended to half of
    its own, and nobody could read the journal any more.
    """

    def __init__(self, file: Path):
        super().__init__(str(file), grace_period=_LOCK_GRACE_SECONDS)
        self._file = file

    def acquire(self) -> bool:
        acquired = super().acquire()
        try:
            _cut_half_line(self._file)
        except BaseException:
            self.release()
            raise
        return acquired


def _cut_half_line(file: Path) -> None:
    with file.open("r+b") as journal:
        if journal.seek(0, os.SEEK_END) == 0:
            return
        journal.seek(-1, os.SEEK_END)
        if journal.read(1) == b"\n":
            return
        journal.seek(0)
        whole = journal.read().rfind(b"\n") + 1
        journal.truncate(whole)


def _check_lines(file: Path) -> None:
    with file.open("rb") as journal:
        for number, line in enumerate(journal, start=1):
            try:
                json.loads(line)
            except ValueError:
                raise RunError(
                    f"Line {number} of '{file}' is damaged: expected a journal of Optuna. A copy "
                    "without that line may still be of use."
                ) from None
