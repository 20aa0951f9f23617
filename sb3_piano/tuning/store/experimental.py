"""What Optuna calls experimental, used without its warning at every call."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator

from optuna.exceptions import ExperimentalWarning


@contextlib.contextmanager
def experimental_allowed() -> Iterator[None]:
    """Leave out Optuna's warnings that something is experimental: our tests would notice."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        yield
