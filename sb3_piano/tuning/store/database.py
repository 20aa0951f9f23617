"""The store of a study for many machines: a database by its URL, as Optuna uses it."""

from __future__ import annotations

import logging
import random
import time
from typing import Any

import sqlalchemy
from optuna.exceptions import StorageInternalError
from optuna.storages import RDBStorage
from sqlalchemy.exc import (
    ArgumentError,
    IntegrityError,
    NoSuchModuleError,
    ProgrammingError,
    SQLAlchemyError,
)

from sb3_piano.exceptions import ConfigError, RunError, near_names
from sb3_piano.tuning.store.experimental import experimental_allowed
from sb3_piano.tuning.store.orphans import retry_callback

HEARTBEAT_INTERVAL = 60
"""Seconds between two signs of life of a worker's trial."""
GRACE_PERIOD = 120
"""Seconds since the last one after which the worker counts as gone."""
CONNECT_TIMEOUT = 10
"""Seconds after which a host that does not answer counts as unreachable."""

_logger = logging.getLogger(__name__)

_EXAMPLE = "postgresql+psycopg://user@host/name"
_ATTEMPTS = 5


def open_database(url: str, *, heartbeat_interval: int, grace_period: int) -> RDBStorage:
    """Return the store in a database, whose tables are made if need be.

    No message shows the URL's password.

    Args:
        url: The database, in SQLAlchemy's form.
        heartbeat_interval: Seconds between two signs of life of a trial, at least 1.
        grace_period: Seconds since the last one after which its worker counts as gone.

    Raises:
        ConfigError: If it is no URL, or none of a database that can be used here.
        RunError: If the database cannot be reached or used.
    """
    parsed = _parsed(url)
    try:
        return _connected(url, parsed, heartbeat_interval, grace_period)
    except NoSuchModuleError:
        name = parsed.drivername
        suggestion = near_names(name, ["postgresql+psycopg", "mysql+pymysql"])
        raise ConfigError(
            f"storage: unknown database {name!r}.{suggestion} Expected one like '{_EXAMPLE}'."
        ) from None
    except ImportError as error:
        driver = getattr(error.__cause__, "name", None) or parsed.drivername
        install = (
            "pip install 'sb3-piano[postgresql]' and the URL postgresql+psycopg://..."
            if parsed.get_backend_name() == "postgresql"
            else f"pip install {driver}"
        )
        raise ConfigError(
            f"storage: '{_shown(parsed)}' needs the Python package {driver!r}, which is not "
            f"installed. Expected: {install}"
        ) from error
    except (SQLAlchemyError, StorageInternalError) as error:
        raise RunError(
            f"Database '{_shown(parsed)}' cannot be used: {why_refused(error)}. Expected a server "
            "that runs, with this database and a role that may make tables in it."
        ) from error
    except RuntimeError as error:  # the tables are of another version
        raise RunError(f"Database '{_shown(parsed)}' cannot be used: {error}") from error


class _Database(RDBStorage):
    """Optuna's store, whose heartbeat goes on after the server was away for a moment.

    In Optuna the first beat that fails is a trial's last one, and the trial is given away.
    """

    def record_heartbeat(self, trial_id: int) -> None:
        try:
            super().record_heartbeat(trial_id)
        except StorageInternalError as error:
            _logger.warning("Heartbeat of a trial missed: %s", why_refused(error))


def shown_url(url: str) -> str:
    """Return a database's URL without the password that it may hold.

    Raises:
        ConfigError: If it is no URL, or none of a database that can be used here.
    """
    return _shown(_parsed(url))


def _parsed(url: str) -> sqlalchemy.URL:
    try:
        parsed = sqlalchemy.make_url(url)
    except (ArgumentError, ValueError):
        # The cause would show a part of it, which may be that of a password.
        shown = "the storage" if "@" in url or "?" in url else f"storage {url!r}"
        raise ConfigError(
            f"{shown} is no URL of a database: expected one like '{_EXAMPLE}', with special "
            "characters of a password written as %40 and so on."
        ) from None
    if parsed.get_backend_name() == "sqlite":
        raise ConfigError(
            "storage is an SQLite file, which is not for several workers at once: expected no "
            f"storage, for the journal in the study's folder, or a server like '{_EXAMPLE}'."
        )
    return parsed


def _connected(
    url: str, parsed: sqlalchemy.URL, heartbeat_interval: int, grace_period: int
) -> RDBStorage:
    """Return the store; what happens when several processes make its tables at once is retried."""
    attempt = 1
    while True:
        try:
            with experimental_allowed():
                return _Database(
                    url.replace("{", "{{").replace("}", "}}"),  # Optuna formats it
                    engine_kwargs=_engine_kwargs(parsed),
                    heartbeat_interval=heartbeat_interval,
                    grace_period=grace_period,
                    heartbeat_stale_trial_callback=retry_callback(),
                )
        except (IntegrityError, ProgrammingError):
            if attempt == _ATTEMPTS:
                raise
        attempt += 1
        time.sleep(random.random())


def _engine_kwargs(url: sqlalchemy.URL) -> dict[str, Any]:
    takes_timeout = url.drivername in ("postgresql", "postgresql+psycopg", "postgresql+psycopg2")
    is_new = takes_timeout and "connect_timeout" not in url.query
    connect_args = {"connect_timeout": CONNECT_TIMEOUT} if is_new else {}
    return {"pool_pre_ping": True, "connect_args": connect_args}


def _shown(url: sqlalchemy.URL) -> str:
    """Return a URL without its password, which may also be among its options."""
    return url.set(query={}).render_as_string(hide_password=True)


def why_refused(error: Exception) -> str:
    """Return in one line why a database refused."""
    cause = error.__cause__ if isinstance(error, StorageInternalError) else error
    text = str(getattr(cause, "orig", None) or cause).strip()
    return text.splitlines()[0].strip().rstrip(".") if text else type(cause).__name__
