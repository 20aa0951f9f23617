"""The errors that users of the package may meet.

Everything raised on purpose derives from :class:`SB3PianoError`. Each leaf also derives from the
built-in exception that a caller who does not know this package would catch.
"""

from __future__ import annotations

import contextlib
import difflib
import errno
import re
from collections.abc import Iterable, Iterator

from sb3_piano.text import told


class SB3PianoError(Exception):
    """Root of all errors raised on purpose by this package, whose message is one line."""

    def __str__(self) -> str:
        return told(super().__str__())


class ScoreError(SB3PianoError, ValueError):
    """A score, or a file that should hold one, is unusable."""


class ScoreWarning(UserWarning):
    """A file was read as a score, but something in it was left out; the message says what."""


class PlanWarning(UserWarning):
    """A piece has notes that cannot be played as they are written; the message says which."""


class UnknownPieceError(SB3PianoError, ValueError):
    """There is no piece of this name, or it is still to be imported."""


class ConfigError(SB3PianoError, ValueError):
    """A setting (of an environment, a YAML file or the command line) is unknown or out of range."""


class MissingPackageError(SB3PianoError, ImportError):
    """An optional package is not installed; the message says what to install."""


class InvalidActionError(SB3PianoError, ValueError):
    """An action has the wrong shape or holds NaN or infinity."""


class EnvStateError(SB3PianoError, RuntimeError):
    """The environment was asked for something its present state does not allow."""


class SimulationDivergedError(SB3PianoError, RuntimeError):
    """The physics became unstable and its state is no longer meaningful."""


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
    """Return what an error of another library says, for a message of ours: never empty."""
    said = str(error).partition("\nException raised from ")[0]  # torch's, a stack of C++
    return " ".join(said.split()) or type(error).__name__


def install_command(extra: str = "") -> str:
    """Return what installs this package, which is on no index, from a clone, with an extra."""
    what = f"'.[{extra}]'" if extra else "."
    return f"pip install {what}  # in a clone of sb3-piano"


_NO_MEMORY = re.compile(
    "(not enough|out of|insufficient) memory|bad_alloc|can't start new thread|failed to map segment"
    "|(can(')?t|cannot|could not|failed to|unable to) allocate",
    re.IGNORECASE,
)


def no_memory(error: BaseException | None) -> bool:
    """Return whether a lack of memory is behind an error: libraries tell it in many ways."""
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
