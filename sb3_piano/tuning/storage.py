"""Stores of studies: Optuna's journal in a study's folder, or a database for many machines."""

from __future__ import annotations

import contextlib
import json
import os
import random
import time
import warnings
from collections.abc import Iterator
from typing import Any

import optuna
import sqlalchemy
from optuna.exceptions import DuplicatedStudyError, ExperimentalWarning, StorageInternalError
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.study import StudyDirection
from optuna.trial import TrialState
from sqlalchemy.exc import (
    ArgumentError,
    IntegrityError,
    NoSuchModuleError,
    ProgrammingError,
    SQLAlchemyError,
)

from sb3_piano.exceptions import ConfigError, RunError, install_command, near_names
from sb3_piano.files import read_file
from sb3_piano.jobs.folders import check_same
from sb3_piano.links import check_inside, make_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.tuning.study import Search, StudyConfig, StudyFolder, make_pruner
from sb3_piano.tuning.trials import ORIGIN, PRESET, PRESET_IN_PART, retry

HEARTBEAT_INTERVAL = 60
"""Seconds between two signs of life of a trial in a database."""
GRACE_PERIOD = 120
"""Seconds since the last one after which its process counts as gone."""
CONNECT_TIMEOUT = 10
"""Seconds after which a host that does not answer counts as unreachable."""
PATIENCE = 60.0
"""Seconds for which a database may be away before who needs it gives up."""

_MOST_BYTES = 2**30
"""Most bytes of a journal."""

_EXAMPLE = "postgresql+psycopg://user@host/name"
_IDENTITY = "identity"
_DEFAULT = Search()
_PATIENCE_SECONDS = 5.0


@contextlib.contextmanager
def opened_store(url: str | None, folder: StudyFolder) -> Iterator[BaseStorage]:
    """Give the store of studies: a database, whose tables are made if need be, or the journal.

    Without a URL, in SQLAlchemy's form, it is the journal in the study's folder, which is made for
    it. No message shows the URL's password.

    Raises:
        ConfigError: If the URL is not valid here.
        RunError: If the database or the journal cannot be used.
    """
    if url is None:
        yield _open_journal(folder)
        return
    store = _open_database(_parsed(url))
    try:
        yield store
    finally:
        store.remove_session()
        store.engine.dispose()


# The journal.


class _JournalLock(JournalFileOpenLock):
    """A lock that is free when its process dies; whoever holds it alone writes into the journal.

    Half a line that a killed process has left is removed.
    """

    def __init__(self, folder: StudyFolder):
        super().__init__(str(folder.journal_file))
        self._file = folder.journal_file
        self._lock_path = folder.workers_dir / f"journal{LOCK_SUFFIX}"
        self._held = contextlib.ExitStack()

    def acquire(self) -> bool:
        """Wait for the lock, and mend the journal."""
        self._held.enter_context(hold(self._lock_path))
        with self._file.open("r+b") as journal:
            end = journal.seek(0, os.SEEK_END)
            journal.seek(max(end - 1, 0))
            if journal.read(1) not in (b"\n", b""):
                journal.seek(0)
                journal.truncate(journal.read().rfind(b"\n") + 1)
        return True

    def release(self) -> None:
        """Let others write."""
        self._held.close()


def _open_journal(folder: StudyFolder) -> JournalStorage:
    file = folder.journal_file
    try:
        make_folder(file.parent)
        check_inside(file)
        if file.exists():
            # Optuna passes over the last line, and stumbles when it goes on. One that has no end
            # yet is being written.
            for line in read_file(file, _MOST_BYTES).split(b"\n")[:-1]:
                json.loads(line)
        return JournalStorage(JournalFileBackend(os.path.realpath(file), _JournalLock(folder)))
    except OSError as error:
        raise RunError(
            f"'{file}' cannot be read and written: {error.strerror}. Expected a place in which "
            "files can be made."
        ) from error
    except Exception:  # Optuna takes it for its own, and a damaged one fails in any way
        raise RunError(
            f"'{file}' is damaged: expected a journal of Optuna, whose lines are JSON. A copy "
            "without the damaged lines may still be of use."
        ) from None


# Databases.


def _open_database(url: sqlalchemy.URL, attempts: int = 5) -> RDBStorage:
    whole = url.render_as_string(hide_password=False)
    is_postgresql = url.drivername in ("postgresql", "postgresql+psycopg", "postgresql+psycopg2")
    is_new = is_postgresql and "connect_timeout" not in url.query
    timeout = {"connect_timeout": CONNECT_TIMEOUT} if is_new else {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ExperimentalWarning)
            store = RDBStorage(
                whole.replace("{", "{{").replace("}", "}}"),  # Optuna formats it
                engine_kwargs={"pool_pre_ping": True, "connect_args": timeout},
                heartbeat_interval=HEARTBEAT_INTERVAL,
                grace_period=GRACE_PERIOD,
                heartbeat_stale_trial_callback=retry,
            )
    except (ImportError, RuntimeError, SQLAlchemyError, StorageInternalError) as error:
        # Several processes may make its tables at once.
        if attempts == 1 or not isinstance(error, (IntegrityError, ProgrammingError)):
            raise _refusal(error, url) from error
        time.sleep(random.random())
        return _open_database(url, attempts - 1)
    sqlalchemy.event.listen(store.engine, "do_connect", _connect_patiently)
    return store


def _connect_patiently(
    dialect: Any, record: object, arguments: list[Any], options: dict[str, Any]
) -> Any:
    """Connect anew to a server that was there before, and may be away for a while."""
    del record
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return dialect.connect(*arguments, **options)
        except dialect.loaded_dbapi.OperationalError:
            if time.monotonic() > end:
                raise
            time.sleep(1)


def _refusal(error: Exception, url: sqlalchemy.URL) -> ConfigError | RunError:
    """Return what to say of a database that cannot be used."""
    shown = _shown(url)
    match error:
        case NoSuchModuleError():
            near = near_names(url.drivername, ["postgresql+psycopg", "mysql+pymysql"])
            return ConfigError(
                f"storage: unknown database {url.drivername!r}.{near} Expected one like {_EXAMPLE}."
            )
        case ImportError():
            driver = getattr(error.__cause__, "name", None) or url.drivername
            install = f"pip install {driver}"
            if url.get_backend_name() == "postgresql":
                install = f"the URL {_EXAMPLE} and {install_command('postgresql')}"
            return ConfigError(
                f"storage: '{shown}' needs the Python package {driver!r}, which is not installed. "
                f"Expected: {install}"
            )
        case SQLAlchemyError() | StorageInternalError():
            return RunError(
                f"Database '{shown}' cannot be used: {why_refused(error)}. Expected a server that "
                "runs, with this database and a role that may make tables in it."
            )
    return RunError(f"Database '{shown}' cannot be used: {error}")  # tables of another version


def shown_url(url: str) -> str:
    """Return a database's URL without the password that it may hold.

    Raises:
        ConfigError: If it is no URL, or none of a database that can be used here.
    """
    return _shown(_parsed(url))


def why_refused(error: Exception) -> str:
    """Return in one line why a database refused."""
    cause = error.__cause__ if isinstance(error, StorageInternalError) else error
    text = str(getattr(cause, "orig", None) or cause).strip()
    return text.splitlines()[0].strip().rstrip(".") if text else type(cause).__name__


def _parsed(url: str) -> sqlalchemy.URL:
    try:
        parsed = sqlalchemy.make_url(url)
    except (ArgumentError, ValueError):
        # The cause would show a part of it, which may be that of a password.
        shown = "the storage" if "@" in url or "?" in url else f"storage {url!r}"
        raise ConfigError(
            f"{shown} is no URL of a database: expected one like {_EXAMPLE}, with special "
            "characters of a password written as %40 and so on."
        ) from None
    if parsed.get_backend_name() == "sqlite":
        raise ConfigError(
            "storage is an SQLite file, which is not for several machines at once: expected no "
            f"storage, for the journal in the study's folder, or a server like {_EXAMPLE}."
        )
    return parsed


def _shown(url: sqlalchemy.URL) -> str:
    """Return a URL without its password, which may also be among its options."""
    return url.set(query={}).render_as_string(hide_password=True)


# Studies in a store.


def open_study(
    config: StudyConfig, storage: BaseStorage, *, name: str, search: Search = _DEFAULT
) -> optuna.Study:
    """Return a study, which is made if need be; its sampler is left to the caller.

    The first trial of a new one waits with the settings from which it departs.

    Raises:
        ConfigError: If another program made it.
        RunError: If it has other settings.
    """
    options: Any = {"study_name": name, "storage": storage, "pruner": make_pruner(search, config)}
    if name not in optuna.get_all_study_names(storage):
        with contextlib.suppress(DuplicatedStudyError):  # another process was faster
            study = optuna.create_study(**options, direction="maximize")
            _fill(study, config)
            return study
    study = optuna.load_study(**options)
    check_same(_identity(study, config), config.identity(), f"Study {name!r}")
    return study


def _fill(study: optuna.Study, config: StudyConfig) -> None:
    """Note down what a new study is, and queue the settings from which it departs.

    The identity comes last, as other processes wait for it.
    """
    study.set_user_attr("study", config.to_mapping())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExperimentalWarning)
        study.set_metric_names([f"{config.objective} {config.metric}"])  # for the dashboard
    params = config.preset_params()
    whole = params.keys() == config.space.distributions.keys()
    origin = PRESET if whole else PRESET_IN_PART
    study.enqueue_trial(params, user_attrs={ORIGIN: origin}, skip_if_exists=True)
    study.set_user_attr(_IDENTITY, config.identity())


def _identity(study: optuna.Study, config: StudyConfig) -> dict[str, Any]:
    """Return what a study is; one that is just being made will have it soon.

    If its maker is gone before anything was run, it is made to an end here.
    """
    end = time.monotonic() + _PATIENCE_SECONDS
    ours = study.directions == [StudyDirection.MAXIMIZE]
    while _IDENTITY not in study.user_attrs:
        if time.monotonic() > end or not ours:
            begun = any(trial.state is not TrialState.WAITING for trial in study.get_trials())
            if begun or not ours:
                raise ConfigError(
                    f"Study {study.study_name!r} is another program's: expected one of 'sb3-piano "
                    "tune'; give yours another name with --name."
                )
            _fill(study, config)
        time.sleep(0.1)
    return study.user_attrs[_IDENTITY]
