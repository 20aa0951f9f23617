"""Studies in their store: opened, made if need be, and refused if they are other ones."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from typing import Any

import optuna
from optuna.exceptions import DuplicatedStudyError
from optuna.storages import BaseStorage
from optuna.study import StudyDirection

from sb3_piano.exceptions import ConfigError
from sb3_piano.tuning.attributes import ORIGIN, PRESET, PRESET_IN_PART
from sb3_piano.tuning.samplers import Search, make_pruner, make_sampler
from sb3_piano.tuning.store.database import GRACE_PERIOD, HEARTBEAT_INTERVAL, open_database
from sb3_piano.tuning.store.experimental import experimental_allowed
from sb3_piano.tuning.store.journal import open_journal
from sb3_piano.tuning.study_config import StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder

_STUDY = "study"
_IDENTITY = "identity"
_PATIENCE_SECONDS = 5.0
_ABSENT = "not set"


def open_storage(
    url: str | None,
    folder: StudyFolder,
    *,
    heartbeat_interval: int = HEARTBEAT_INTERVAL,
    grace_period: int = GRACE_PERIOD,
) -> BaseStorage:
    """Return the store of studies: a database, or the journal in a study's folder.

    Args:
        url: The database; ``None`` for the journal.
        folder: The study's folder, which is made for the journal.
        heartbeat_interval: Seconds between two signs of life of a trial in a database.
        grace_period: Seconds since the last one after which its worker counts as gone.

    Raises:
        ConfigError: If the URL is not valid here.
        RunError: If the database or the journal cannot be used.
    """
    if url is None:
        return open_journal(folder.journal_file)
    return open_database(url, heartbeat_interval=heartbeat_interval, grace_period=grace_period)


def open_study(
    config: StudyConfig,
    folder: StudyFolder,
    *,
    name: str,
    url: str | None = None,
    search: Search = Search(),  # noqa: B008 - frozen
) -> optuna.Study:
    """Return a study, which is made if need be.

    The first trial of a new one waits with the settings from which it departs.

    Args:
        config: The study.
        folder: Its folder on this machine.
        name: Its name in the store.
        url: The database that it is in; by default the journal in its folder.
        search: How settings are chosen and trials ended early.

    Raises:
        ConfigError: If there is another study of that name, or the URL is not valid.
        RunError: If the database or the journal cannot be used.
    """
    storage = open_storage(url, folder)
    options: dict[str, Any] = {
        "study_name": name,
        "storage": storage,
        "sampler": make_sampler(search),
        "pruner": make_pruner(search, config),
    }
    if name not in optuna.get_all_study_names(storage):
        try:
            study = optuna.create_study(**options, direction="maximize")
        except DuplicatedStudyError:  # another process was faster
            pass
        else:
            _fill(study, config)
            return study
    study = optuna.load_study(**options)
    _check(study, config)
    return study


def _fill(study: optuna.Study, config: StudyConfig) -> None:
    """Note down what a new study is, and queue the settings from which it departs.

    Only the process that made it does so. The identity comes last, as others wait for it.
    """
    study.set_user_attr(_STUDY, _as_stored(config.to_mapping()))
    with experimental_allowed():
        study.set_metric_names([f"{config.objective} {config.metric}"])  # for the dashboard
    params = config.preset_params()
    whole = params.keys() == config.space.distributions.keys()
    origin = PRESET if whole else PRESET_IN_PART
    study.enqueue_trial(params, user_attrs={ORIGIN: origin}, skip_if_exists=True)
    study.set_user_attr(_IDENTITY, _as_stored(config.identity()))


def _check(study: optuna.Study, config: StudyConfig) -> None:
    """Refuse a study that is another one than the settings say.

    Raises:
        ConfigError: If it is.
    """
    name = study.study_name
    if study.directions != [StudyDirection.MAXIMIZE]:
        directions = " and ".join(direction.name.lower() for direction in study.directions)
        raise ConfigError(
            f"Study {name!r} is to {directions} something: another program made it. Expected a "
            "study of 'sb3-piano tune'; give yours another name with --name."
        )
    there, here = _identity(study), _as_stored(config.identity())
    goals = [f"{identity.get('objective')} {identity.get('metric')}" for identity in (there, here)]
    if goals[0] != goals[1]:
        raise ConfigError(
            f"Study {name!r} maximises '{goals[0]}', not '{goals[1]}': give the study another name "
            f"with --name, or the same metric and objective."
        )
    differences = _differences(there, here)
    if differences:
        raise ConfigError(
            f"Study {name!r} has other settings: {'; '.join(differences)}. Give the study another "
            "name with --name, or the same settings."
        )


def _identity(study: optuna.Study) -> dict[str, Any]:
    """Return what a study is; one that is just being made will have it soon.

    Raises:
        ConfigError: If it does not get it.
    """
    end = time.monotonic() + _PATIENCE_SECONDS
    while True:
        identity = study.user_attrs.get(_IDENTITY)
        if identity is not None:
            return identity
        if time.monotonic() > end:
            raise ConfigError(
                f"Study {study.study_name!r} does not say what it is: another program made it, or "
                "its maker was killed at once. Give the study another name with --name."
            )
        time.sleep(0.1)


def _as_stored(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping as it comes back from a store."""
    return json.loads(json.dumps(mapping))


def _differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    flat_there, flat_here = _flat(there), _flat(here)
    names = dict.fromkeys((*flat_there, *flat_here))
    pairs = [(n, flat_there.get(n, _ABSENT), flat_here.get(n, _ABSENT)) for n in names]
    return [
        f"{n.removeprefix('entry.')} is {_text(a)} there, {_text(b)} here"
        for n, a, b in pairs
        if a != b
    ]


def _text(value: Any) -> str:
    return value if value is _ABSENT else json.dumps(value)


def _flat(mapping: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in mapping.items():
        if isinstance(value, Mapping) and value:
            flat.update(_flat(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat
