"""The errors that users of the package may meet.

Everything raised on purpose derives from :class:`SB3PianoError`. Each leaf also derives from the
built-in exception that a caller who does not know this package would catch.
"""

from __future__ import annotations

import contextlib
import difflib
import errno
import pickle
import re
import traceback
from collections.abc import Iterable, Iterator

from sb3_piano.text import shortened


class SB3PianoError(Exception):
    """Base of all errors that this package raises on purpose; the message is one line."""

    def __str__(self) -> str:
        return shortened(super().__str__())


class ScoreError(SB3PianoError, ValueError):
    """A score is invalid, or a file cannot be read as one."""


class ScoreWarning(UserWarning):
    """A file was read as a score without some of its content; the message names it."""


class PlanWarning(UserWarning):
    """A piece has notes that the hands cannot play as written; the message names them."""


class UnknownPieceError(SB3PianoError, ValueError):
    """No piece has this name, or it is not imported yet."""


class ConfigError(SB3PianoError, ValueError):
    """A setting (of an environment, a YAML file or the command line) is unknown or out of range."""


class MissingPackageError(SB3PianoError, ImportError):
    """An optional package is not installed; the message says what to install."""


class InvalidActionError(SB3PianoError, ValueError):
    """An action has the wrong shape or holds NaN or infinity."""


class EnvStateError(SB3PianoError, RuntimeError):
    """The environment cannot do this in its present state."""


class SimulationDivergedError(SB3PianoError, RuntimeError):
    """The physics became unstable, and its state has no meaning any more."""


class RenderingError(SB3PianoError, RuntimeError):
    """No picture can be drawn on this machine."""


class RunError(SB3PianoError, RuntimeError):
    """A training run's folder cannot be created, read or continued."""


@contextlib.contextmanager
def naming(place: str, kind: type[SB3PianoError] = ConfigError) -> Iterator[None]:
    """Let the message of an error begin with where something is wrong.

    Raises:
        ConfigError: In place of one of the ``kind``.
    """
    try:
        yield
    except kind as error:
        raise ConfigError(f"{place}: {error}") from error


def one_line(error: BaseException) -> str:
    """Return another library's error message in one line, never empty."""
    said = str(error).partition("\nException raised from ")[0]  # torch's, a stack of C++
    return " ".join(said.split()) or type(error).__name__


def install_command(extra: str = "") -> str:
    """Return the command that installs this package, with an extra, from a clone."""
    what = f"'.[{extra}]'" if extra else "."
    return f"pip install {what}  # in a clone of sb3-piano"


_NO_MEMORY = re.compile(
    "(not enough|out of|insufficient) memory|bad_alloc|can't start new thread|failed to map segment"
    "|(can(')?t|cannot|could not|failed to|unable to) allocate",
    re.IGNORECASE,
)


def sendable(error: BaseException) -> BaseException:
    """Return an error, or one with its text if other processes cannot read it.

    A note of it has the traceback, which pickling drops.
    """
    note = "In a worker:\n" + "".join(traceback.format_exception(error))
    error.add_note(note)
    try:
        pickle.loads(pickle.dumps(error))  # many can be pickled but not unpickled
    except Exception:
        error = RunError(f"{type(error).__name__}: {one_line(error)}")
        error.add_note(note)
    return error


def no_memory(error: BaseException | None) -> bool:
    """Return whether an error or one of its causes is a lack of memory."""
    while error is not None:
        lacks = isinstance(error, OSError) and error.errno == errno.ENOMEM
        if lacks or isinstance(error, MemoryError) or _NO_MEMORY.search(str(error)):
            return True
        error = error.__cause__ or error.__context__
    return False


def near_names(name: str, known: Iterable[str]) -> str:
    """Return ``" Did you mean 'a' or 'b'?"``, or an empty string if nothing is similar."""
    by_lower = {candidate.lower(): candidate for candidate in known}
    matches = difflib.get_close_matches(name.lower(), by_lower, n=3, cutoff=0.5)
    if not matches:
        return ""
    return f" Did you mean {' or '.join(repr(by_lower[match]) for match in matches)}?"
