"""Storage of studies: Optuna's journal in a study's folder, or a database for many machines."""

from __future__ import annotations

import contextlib
import os
import random
import time
from collections.abc import Iterator
from typing import Any

import optuna
import sqlalchemy
from optuna.exceptions import DuplicatedStudyError, StorageInternalError
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.study import StudyDirection
from optuna.trial import TrialState
from sqlalchemy.exc import IntegrityError, ProgrammingError, SQLAlchemyError

from sb3_piano.exceptions import ConfigError, RunError, install_command, one_line
from sb3_piano.jobs.folders import check_same
from sb3_piano.links import check_inside, make_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.tuning import study as of_study
from sb3_piano.tuning.study import Search, StudyConfig, StudyFolder

HEARTBEAT_INTERVAL = 60  # s, between two heartbeats of a trial in a database
GRACE_PERIOD = 120  # s, after the last heartbeat until its process counts as dead
PATIENCE = 60.0  # s, to wait for a database that is unavailable

_IDENTITY = "identity"
_MAKING_SECONDS = 5.0


@contextlib.contextmanager
def opened_store(url: str | None, folder: StudyFolder) -> Iterator[BaseStorage]:
    """Open the database of a URL, with tables, or without a URL the journal in a study's folder.

    A ``RunError`` says why it cannot be used, and never shows the URL's password.
    """
    if url is None:
        yield _open_journal(folder)
        return
    store = _open_database(url)
    try:
        yield store
    except StorageInternalError as error:
        raise RunError(
            f"Database '{shown_url(url)}' cannot be used any more: {_why_refused(error)}. Its "
            "content is kept: when it is back, the same command goes on."
        ) from error
    finally:
        store.remove_session()
        store.engine.dispose()


class _JournalLock(JournalFileOpenLock):
    """Lock that is free when its process dies; removes a dead process's incomplete line."""

    def __init__(self, folder: StudyFolder):
        super().__init__(str(folder.journal_file))
        self._folder = folder
        self._held = contextlib.ExitStack()

    def acquire(self) -> bool:
        """Wait for the lock, and repair the journal."""
        self._held.enter_context(hold(self._folder.workers_dir / f"journal{LOCK_SUFFIX}"))
        with self._folder.journal_file.open("r+b") as journal:
            journal.truncate(journal.read().rfind(b"\n") + 1)
        return True

    def release(self) -> None:
        """Release the lock."""
        self._held.close()


def _open_journal(folder: StudyFolder) -> JournalStorage:
    file = folder.journal_file
    try:
        make_folder(file.parent)
        check_inside(file)
        return JournalStorage(JournalFileBackend(os.path.realpath(file), _JournalLock(folder)))
    except Exception as error:  # a damaged journal may raise anything
        raise RunError(
            f"'{file}' cannot be used ({one_line(error)}): expected a journal of Optuna "
            "with JSON in each line, in a writable folder."
        ) from error


def _open_database(url: str, attempts: int = 5) -> RDBStorage:
    try:
        parsed = sqlalchemy.make_url(url)
        if parsed.get_backend_name() == "sqlite":
            raise RuntimeError("SQLite is not for several machines at once")
        whole = parsed.render_as_string(hide_password=False)
        with of_study.optuna_experiments():
            store = RDBStorage(
                whole.replace("{", "{{").replace("}", "}}"),  # Optuna formats it
                engine_kwargs={"pool_pre_ping": True},
                heartbeat_interval=HEARTBEAT_INTERVAL,
                grace_period=GRACE_PERIOD,
                heartbeat_stale_trial_callback=of_study.retry,
            )
    except (ImportError, RuntimeError, SQLAlchemyError, StorageInternalError, ValueError) as error:
        # Several processes may create its tables at once.
        if attempts > 1 and isinstance(error, (IntegrityError, ProgrammingError)):
            time.sleep(random.random())
            return _open_database(url, attempts - 1)
        raise RunError(
            f"Database '{shown_url(url)}' cannot be used: {_why_refused(error)}. Expected a server "
            "that runs, with this database and a role that may create tables in it, such as "
            f"postgresql+psycopg://user@host/name ({install_command('postgresql')}); without "
            "storage, the study is kept in its folder."
        ) from None
    sqlalchemy.event.listen(store.engine, "do_connect", _connect_patiently)
    return store


def _connect_patiently(
    dialect: Any, record: object, arguments: list[Any], options: dict[str, Any]
) -> Any:
    """Reconnect to a server that may be unavailable for a while."""
    del record
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return dialect.connect(*arguments, **options)
        except dialect.loaded_dbapi.OperationalError:
            if time.monotonic() > end:
                raise
            time.sleep(1)


def shown_url(url: str) -> str:
    """Return a database's URL without a password, also in its options."""
    try:
        return sqlalchemy.make_url(url).set(query={}).render_as_string(hide_password=True)
    except (SQLAlchemyError, ValueError):  # any part may belong to a password
        return "..." if "@" in url or "?" in url else url


def _why_refused(error: Exception) -> str:
    """Return the reason of a database error in one line."""
    return one_line(error.__cause__ or error).rstrip(".")


def open_study(
    config: StudyConfig, storage: BaseStorage, *, name: str, search: Search
) -> optuna.Study:
    """Load a study, or create it; the caller sets its sampler.

    A new study starts with a waiting trial of the settings from which it departs. A study of
    another program or of other settings is refused.
    """
    options: Any = {
        "study_name": name,
        "storage": storage,
        "pruner": of_study.make_pruner(search, config),
    }
    try:
        study = optuna.create_study(**options, direction="maximize")
    except DuplicatedStudyError:
        study = optuna.load_study(**options)
        if _IDENTITY not in study.user_attrs:  # another process is just creating it
            time.sleep(_MAKING_SECONDS)
    if _IDENTITY not in study.user_attrs:  # it is new, or its creator was killed at once
        begun = any(trial.state is not TrialState.WAITING for trial in study.get_trials())
        if begun or study.directions != [StudyDirection.MAXIMIZE]:
            raise ConfigError(
                f"Study {name!r} is another program's: expected a study of 'sb3-piano tune'. "
                "Choose another name with --name."
            )
        with of_study.optuna_experiments():
            study.set_metric_names([config.value_name])  # for the dashboard
        params = config.preset_params()
        whole = params.keys() == config.space.distributions.keys()
        origin = {of_study.ORIGIN: of_study.PRESET if whole else of_study.PRESET_IN_PART}
        study.enqueue_trial(params, user_attrs=origin, skip_if_exists=True)
        study.set_user_attr(_IDENTITY, config.identity())  # last, as other processes wait for it
    check_same(study.user_attrs[_IDENTITY], config.identity(), f"Study {name!r}")
    return study
