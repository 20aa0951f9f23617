"""Stores of studies: a journal or a database, what is refused, and what makes two studies one."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import os
import socket
import time
from pathlib import Path

import optuna
import pytest
import sqlalchemy
from optuna.exceptions import ExperimentalWarning
from optuna.trial import TrialState

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.tuning.attributes import ORIGIN, PRESET, PRESET_IN_PART
from sb3_piano.tuning.samplers import Search
from sb3_piano.tuning.search_space.space import Space
from sb3_piano.tuning.store import database, journal, storage
from sb3_piano.tuning.store.storage import open_storage, open_study
from sb3_piano.tuning.study_config import StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder

# Optuna means ask and tell, with which no heart beats.
pytestmark = pytest.mark.filterwarnings("ignore:Heartbeat of storage:UserWarning")

FORK = multiprocessing.get_context("fork")

CONFIG = StudyConfig(
    algo="sac",
    env_id="RoboPianist-debug-TwinkleTwinkleLittleStar-v0",
    entry={"n_timesteps": 1000, "policy": "MlpPolicy", "learning_rate": 3e-4, "batch_size": 64},
    space=Space(
        {
            "learning_rate": {"float": [1e-5, 1e-2], "log": True},
            "batch_size": {"choice": [64, 128]},
            "tau": {"float": [0.001, 0.1], "log": True},
        }
    ),
)


def changed(**settings) -> StudyConfig:
    return dataclasses.replace(CONFIG, **settings)


@pytest.fixture
def folder(tmp_path) -> StudyFolder:
    return StudyFolder(tmp_path / "study")


@pytest.fixture(params=["embedded", "database"])
def url(request) -> str | None:
    return None if request.param == "embedded" else request.getfixturevalue("database_url")


# What makes two studies one.


@pytest.mark.slow
def test_a_new_study_says_what_it_is_and_waits_with_the_preset(folder, url):
    study = open_study(CONFIG, folder, name="twinkle", url=url)
    assert study.study_name == "twinkle"
    assert study.direction == optuna.study.StudyDirection.MAXIMIZE
    stored = optuna.load_study(study_name="twinkle", storage=open_storage(url, folder)).user_attrs
    assert StudyConfig.from_mapping(stored["study"]) == CONFIG
    assert stored["identity"] == json.loads(json.dumps(CONFIG.identity()))
    (preset,) = study.get_trials()
    assert preset.state is TrialState.WAITING
    assert preset.user_attrs == {ORIGIN: PRESET}
    trial = study.ask()
    settings = CONFIG.space.suggest(trial)
    assert (settings["learning_rate"], settings["batch_size"]) == (3e-4, 64)


def test_a_preset_that_the_space_holds_in_part_is_noted_as_such(folder):
    space = Space({**CONFIG.space, "batch_size": {"choice": [128, 256]}})
    (preset,) = open_study(changed(space=space), folder, name="twinkle").get_trials()
    assert preset.user_attrs == {ORIGIN: PRESET_IN_PART}
    assert "batch_size" not in preset.system_attrs["fixed_params"]


@pytest.mark.slow
def test_a_study_opened_again_is_the_same_one(folder, url):
    open_study(CONFIG, folder, name="twinkle", url=url).ask()
    again = open_study(CONFIG, folder, name="twinkle", url=url)
    assert [trial.state for trial in again.get_trials()] == [TrialState.RUNNING]


def test_a_study_has_the_sampler_and_the_pruner_of_the_search(folder):
    search = Search(sampler="random", pruner="hyperband")
    for _ in range(2):  # when it is made, and when it is there
        study = open_study(CONFIG, folder, name="twinkle", search=search)
        assert isinstance(study.sampler, optuna.samplers.RandomSampler)
        assert isinstance(study.pruner, optuna.pruners.HyperbandPruner)


@pytest.mark.slow
def test_who_finds_that_another_made_the_study_just_before_joins_it(folder, url, monkeypatch):
    names_of = optuna.get_all_study_names

    def names_before(store) -> list[str]:
        names = names_of(store)
        monkeypatch.undo()
        open_study(CONFIG, folder, name="twinkle", url=url)
        return names

    monkeypatch.setattr(optuna, "get_all_study_names", names_before)
    study = open_study(CONFIG, folder, name="twinkle", url=url)
    assert [trial.user_attrs for trial in study.get_trials()] == [{ORIGIN: PRESET}]
    with pytest.raises(ConfigError, match="seeds"):
        open_study(changed(seeds=(1,)), folder, name="twinkle", url=url)


def open_together(folder, url, barrier, said) -> None:
    barrier.wait(30)
    try:
        study = open_study(CONFIG, folder, name="twinkle", url=url)
        said.put(len(study.get_trials()))
    except Exception as error:
        said.put(repr(error))


@pytest.mark.slow
def test_processes_that_open_a_new_study_at_once_make_one_with_one_preset(folder, url):
    said, barrier = FORK.Queue(), FORK.Barrier(4)
    processes = [
        FORK.Process(target=open_together, args=(folder, url, barrier, said)) for _ in range(4)
    ]
    for process in processes:
        process.start()
    assert [said.get(timeout=60) for _ in processes] == [1] * 4
    for process in processes:
        process.join()
    study = open_study(CONFIG, folder, name="twinkle", url=url)
    assert [trial.user_attrs for trial in study.get_trials()] == [{ORIGIN: PRESET}]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (
            {"metric": "onset_f1", "objective": "best"},
            "Study 'twinkle' maximises 'final f1', not 'best onset_f1': give the study another "
            "name with --name, or the same metric and objective.",
        ),
        (
            {"seeds": (0, 1), "minutes": 2.0},
            r"Study 'twinkle' has other settings: seeds is \[0\] there, \[0, 1\] here; minutes is "
            "null there, 2.0 here. Give the study another name with --name, or the same settings.",
        ),
        (
            {"entry": {"n_timesteps": 2000, "policy": "MlpPolicy", "gamma": 0.8}},
            "n_timesteps is 1000 there, 2000 here; learning_rate is 0.0003 there, not set here; "
            "batch_size is 64 there, not set here; gamma is not set there, 0.8 here. Give",
        ),
        (
            {"space": Space({**CONFIG.space, "tau": {"float": [0.001, 0.2], "log": True}})},
            r"settings: space.tau.float is \[0.001, 0.1\] there, \[0.001, 0.2\] here. Give",
        ),
    ],
)
def test_another_study_of_the_same_name_is_refused(other, message, folder):
    open_study(CONFIG, folder, name="twinkle")
    with pytest.raises(ConfigError, match=message):
        open_study(changed(**other), folder, name="twinkle")
    assert len(open_study(changed(**other), folder, name="other").get_trials()) == 1


def test_a_whole_number_is_the_same_with_a_point(folder):
    open_study(CONFIG, folder, name="twinkle")
    open_study(changed(entry={**CONFIG.entry, "n_timesteps": 1000.0}), folder, name="twinkle")


def test_a_tuple_is_the_same_as_the_list_that_a_store_gives_back(folder):
    config = changed(entry={**CONFIG.entry, "policy_kwargs": {"net_arch": (64, 64)}})
    open_study(config, folder, name="twinkle")
    open_study(config, folder, name="twinkle")


def test_studies_of_one_score_are_the_same_wherever_the_file_is(folder, tmp_path):
    def with_score(content: bytes, name: str) -> StudyConfig:
        file = tmp_path / name
        file.write_bytes(content)
        return changed(entry={**CONFIG.entry, "env_kwargs": {"score": str(file)}})

    open_study(with_score(b"one", "a.mid"), folder, name="piece")
    open_study(with_score(b"one", "b.mid"), folder, name="piece")
    with pytest.raises(ConfigError, match='env_kwargs.score is "sha256 [0-9a-f]{64}" there, "sha'):
        open_study(with_score(b"two", "b.mid"), folder, name="piece")


@pytest.mark.parametrize(
    ("directions", "word"),
    [(["minimize"], "minimize"), (["maximize", "minimize"], "maximize and minimize")],
)
def test_a_study_with_another_direction_is_refused(directions, word, folder):
    store = open_storage(None, folder)
    optuna.create_study(study_name="twinkle", storage=store, directions=directions)
    with pytest.raises(ConfigError, match=f"Study 'twinkle' is to {word} something: another"):
        open_study(CONFIG, folder, name="twinkle")


def test_a_study_of_another_program_is_refused(folder, monkeypatch):
    monkeypatch.setattr(storage, "_PATIENCE_SECONDS", 0.2)
    store = open_storage(None, folder)
    optuna.create_study(study_name="twinkle", storage=store, direction="maximize")
    with pytest.raises(ConfigError, match="Study 'twinkle' does not say what it is: another"):
        open_study(CONFIG, folder, name="twinkle")


def make_slowly(folder, said) -> None:
    store = open_storage(None, folder)
    study = optuna.create_study(study_name="twinkle", storage=store, direction="maximize")
    said.put("made")
    time.sleep(0.5)
    study.set_user_attr("identity", json.loads(json.dumps(CONFIG.identity())))


def test_a_study_that_is_just_being_made_is_waited_for(folder):
    said = FORK.Queue()
    process = FORK.Process(target=make_slowly, args=(folder, said))
    process.start()
    said.get(timeout=30)
    assert open_study(CONFIG, folder, name="twinkle").get_trials() == []
    process.join()


# The journal.


def fill_journal(folder: StudyFolder) -> Path:
    study = open_study(CONFIG, folder, name="twinkle")
    study.tell(study.ask(), 0.5)
    return folder.journal_file


def test_a_half_line_that_a_killed_writer_left_is_cut_off(folder):
    file = fill_journal(folder)
    whole = file.read_bytes()
    file.write_bytes(whole + b'{"op_code":5,"worker')
    study = open_study(CONFIG, folder, name="twinkle")
    assert file.read_bytes() == whole
    study.tell(study.ask(), 0.7)
    trials = open_study(CONFIG, folder, name="twinkle").get_trials()
    assert [trial.value for trial in trials] == [0.5, 0.7]


def test_a_half_line_that_is_left_while_others_work_harms_nobody(folder):
    file = fill_journal(folder)
    study, other = (open_study(CONFIG, folder, name="twinkle") for _ in range(2))
    with file.open("ab") as journal_file:
        journal_file.write(b'{"op_code":5,"worker')
    assert len(other.get_trials()) == 1  # one that reads meanwhile
    study.tell(study.ask(), 0.7)
    for view in (study, other, open_study(CONFIG, folder, name="twinkle")):
        assert [trial.value for trial in view.get_trials()] == [0.5, 0.7]


def test_a_journal_of_half_a_line_is_a_new_one(folder):
    folder.path.mkdir()
    folder.journal_file.write_bytes(b'{"op_c')
    assert len(open_study(CONFIG, folder, name="twinkle").get_trials()) == 1


def lock_journal(folder: StudyFolder, said) -> None:
    open_storage(None, folder)._backend._lock.acquire()
    said.put("locked")
    time.sleep(60)


def write_and_be_killed(folder: StudyFolder, said) -> None:
    study = open_study(CONFIG, folder, name="twinkle")
    said.put("begin")
    while True:
        study.set_user_attr("text", "x" * 200_000)  # written in several pieces


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The value of `grace_period` might be too small:UserWarning")
@pytest.mark.parametrize("seconds", [0.0, 0.01, 0.05])
def test_a_journal_outlives_a_worker_killed_in_the_middle_of_writing(seconds, folder, monkeypatch):
    monkeypatch.setattr(journal, "_LOCK_GRACE_SECONDS", 1)
    said = FORK.Queue()
    process = FORK.Process(target=write_and_be_killed, args=(folder, said))
    process.start()
    said.get(timeout=30)
    time.sleep(seconds)
    process.kill()
    process.join()
    study = open_study(CONFIG, folder, name="twinkle")
    study.tell(study.ask(), 0.5)
    assert [trial.value for trial in open_study(CONFIG, folder, name="twinkle").get_trials()] == [
        0.5
    ]


@pytest.mark.filterwarnings("ignore:The value of `grace_period` might be too small:UserWarning")
def test_a_lock_that_a_killed_writer_left_is_broken_also_by_a_relative_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(journal, "_LOCK_GRACE_SECONDS", 1)
    folder = StudyFolder(Path("study"))
    lock = f"{fill_journal(folder)}.lock"
    said = FORK.Queue()
    process = FORK.Process(target=lock_journal, args=(folder, said))
    process.start()
    said.get(timeout=30)
    process.kill()
    process.join()
    assert os.path.exists(lock)  # a link to the journal; Optuna waits for ever if it is broken
    assert len(open_study(CONFIG, folder, name="twinkle").get_trials()) == 1
    assert not os.path.lexists(lock)


@pytest.mark.parametrize("damage", [b"\x00\x01\x02", b'{"op_code":5,"wor', b"nonsense"])
def test_a_journal_with_a_damaged_line_is_refused_by_its_number(damage, folder):
    file = fill_journal(folder)
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join([*lines[:2], damage + b"\n", *lines[3:]]))
    with pytest.raises(RunError, match=f"Line 3 of '{file}' is damaged: expected a journal of"):
        open_storage(None, folder)


@pytest.mark.parametrize("line", ["{}", "[1]", "3", '{"op_code": 99}', '{"op_code": 0}'])
def test_a_file_that_is_no_journal_is_refused(line, folder):
    folder.path.mkdir()
    folder.journal_file.write_text(f"{line}\n")
    with pytest.raises(RunError, match=f"'{folder.journal_file}' is damaged: expected a journal"):
        open_storage(None, folder)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    folder = StudyFolder(tmp_path / "file" / "study")
    with pytest.raises(RunError, match="journal.log' cannot be read and written: Not a directory"):
        open_storage(None, folder)


# Databases.


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("nonsense", "storage 'nonsense' is no URL of a database: expected one like 'postgresql"),
        ("", "storage '' is no URL of a database"),
        ("sqlite:///study.db", "storage is an SQLite file, which is not for several workers"),
        ("postgres://host/name", "unknown database 'postgres'. Did you mean 'postgresql.psycopg'?"),
        ("postgresql+nosuch://host/name", r"unknown database 'postgresql\+nosuch'. Did you mean"),
        (
            "postgresql+asyncpg://host/name",
            r"'postgresql\+asyncpg://host/name' needs the Python package 'asyncpg', which is not "
            r"installed. Expected: pip install 'sb3-piano\[postgresql\]' and the URL",
        ),
        ("oracle://host/name", "needs the Python package '.*oracle.*'.* Expected: pip install "),
    ],
)
def test_a_url_of_no_database_for_this_is_refused(url, message, folder):
    with pytest.raises(ConfigError, match=message):
        open_storage(url, folder)


@pytest.mark.parametrize(
    "url",
    [
        "postgresql//me:pass@host/name",
        "postgresql+psycopg://me:pass/word@host:pass/name",
        "postgresql+psycopg://me:pass@host:port/name",
        "postgres://me:pass@host/name",
        "postgresql+asyncpg://me:pass@host/name",
        "postgresql+asyncpg://me@host/name?password=pass",
        "postgresql+psycopg://me:pass@127.0.0.1:1/name",
        "postgresql+psycopg://me@127.0.0.1:1/name?password=pass",
        "sqlite:///study.db?password=pass",
    ],
)
def test_no_message_shows_a_password(url, folder):
    with pytest.raises((ConfigError, RunError), match=".") as caught:
        open_storage(url, folder)
    assert "pass@" not in str(caught.value)
    assert "word" not in str(caught.value).replace("password as", "").replace("a password", "")
    assert "=pass" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_server_that_does_not_run_is_named(folder):
    with socket.create_server(("127.0.0.1", 0)) as closed_soon:
        port = closed_soon.getsockname()[1]
    url = f"postgresql+psycopg://me:secret@127.0.0.1:{port}/piano"
    with pytest.raises(RunError, match="Connection refused. Expected a server that runs") as caught:
        open_storage(url, folder)
    assert f"Database 'postgresql+psycopg://me:***@127.0.0.1:{port}/piano'" in str(caught.value)


def try_to_open(url: str, folder: StudyFolder, said) -> None:
    try:
        open_storage(url, folder)
    except Exception as error:
        said.put(str(error))


def test_a_host_that_never_answers_is_given_up(folder, monkeypatch):
    monkeypatch.setattr(database, "CONNECT_TIMEOUT", 2)
    said = FORK.Queue()
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"postgresql+psycopg://me@127.0.0.1:{silent.getsockname()[1]}/piano"
        process = FORK.Process(target=try_to_open, args=(url, folder, said))
        process.start()
        message = said.get(timeout=60)  # the driver alone would take more than two minutes
    process.join()
    assert "timeout expired. Expected a server that runs" in message


def test_a_database_that_does_not_exist_is_named(postgresql_url, folder):
    url = sqlalchemy.make_url(postgresql_url).set(database="nowhere").render_as_string()
    with pytest.raises(RunError, match='/nowhere.* database "nowhere" does not exist. Expected'):
        open_storage(url, folder)


def test_a_role_that_does_not_exist_is_named(postgresql_url, folder):
    url = sqlalchemy.make_url(postgresql_url).set(username="nobody").render_as_string()
    with pytest.raises(RunError, match='role "nobody" does not exist. Expected'):
        open_storage(url, folder)


def test_a_role_that_may_make_no_tables_is_refused(database_url, folder):
    execute(database_url, "CREATE ROLE guest LOGIN")
    url = sqlalchemy.make_url(database_url).set(username="guest").render_as_string()
    with pytest.raises(RunError, match="permission denied for schema public. Expected a server"):
        open_storage(url, folder)


def execute(url: str, statement: str) -> None:
    engine = sqlalchemy.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sqlalchemy.text(statement))
    engine.dispose()


def test_tables_of_another_version_of_optuna_are_refused(database_url, folder):
    open_storage(database_url, folder)
    execute(database_url, "UPDATE alembic_version SET version_num = 'v2.6.0.a'")
    with pytest.raises(RunError, match="Database '.*' cannot be used: .*optuna storage upgrade"):
        open_storage(database_url, folder)


def test_a_password_may_hold_any_character(database_url, folder):
    url = database_url.replace("://postgres@", "://postgres:{a}%40{@")
    assert url != database_url
    assert open_storage(url, folder).get_all_studies() == []


def test_a_database_has_heartbeats_that_are_looked_at_by_others(database_url, folder):
    store = open_storage(database_url, folder)
    assert (store.get_heartbeat_interval(), store.grace_period) == (60, 120)
    assert store.get_heartbeat_stale_trial_callback() is not None


def test_a_connection_that_broke_is_made_again(database_url, folder):
    study = open_study(CONFIG, folder, name="twinkle", url=database_url)
    execute(
        database_url,
        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = "
        "current_database() AND pid != pg_backend_pid()",
    )
    assert len(study.get_trials()) == 1


def test_no_experimental_warning_reaches_the_user(url, folder, recwarn):
    open_study(CONFIG, folder, name="twinkle", url=url)
    assert not [found for found in recwarn if issubclass(found.category, ExperimentalWarning)]
