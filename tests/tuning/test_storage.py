"""Stores of studies: a journal or a database, what is refused, and what makes two studies one."""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import signal
from pathlib import Path

import optuna
import pytest
import sqlalchemy
from optuna.exceptions import ExperimentalWarning
from optuna.trial import TrialState
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.tuning import storage
from sb3_piano.tuning.space import Space
from sb3_piano.tuning.storage import open_study, opened_store
from sb3_piano.tuning.study import ORIGIN, PRESET, PRESET_IN_PART, Search, StudyConfig, StudyFolder

tables = Tables(__file__)

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
def opened(folder):
    """A function that opens a study, whose store is closed in the end."""
    with contextlib.ExitStack() as stack:

        def open_one(config=CONFIG, url=None, name="twinkle", **options) -> optuna.Study:
            store = stack.enter_context(opened_store(url, folder))
            return open_study(config, store, name=name, search=Search(**options))

        yield open_one


def open_store(url: str | None, folder: StudyFolder) -> None:
    with opened_store(url, folder):
        pass


@pytest.fixture
def folder(tmp_path) -> StudyFolder:
    return StudyFolder(tmp_path / "study")


# What makes two studies one.


@pytest.mark.slow
@pytest.mark.parametrize("where", ["embedded", "database"])
def test_a_new_study_says_what_it_is_and_waits_with_the_preset(opened, where, request, recwarn):
    url = None if where == "embedded" else request.getfixturevalue("database_url")
    study = opened(url=url, pruner="hyperband")
    assert study.direction == optuna.study.StudyDirection.MAXIMIZE
    assert study.user_attrs["identity"] == CONFIG.identity()
    (preset,) = study.get_trials()
    assert preset.state is TrialState.WAITING
    assert preset.user_attrs == {ORIGIN: PRESET}
    settings = CONFIG.space.suggest(study.ask())
    assert (settings["learning_rate"], settings["batch_size"]) == (3e-4, 64)
    again = opened(url=url, pruner="hyperband")
    for each in (study, again):
        assert isinstance(each.pruner, optuna.pruners.HyperbandPruner)
    assert [trial.state for trial in again.get_trials()] == [TrialState.RUNNING]
    assert not [found for found in recwarn if issubclass(found.category, ExperimentalWarning)]


def test_a_preset_that_the_space_holds_in_part_is_noted_as_such(opened):
    space = Space({**CONFIG.space, "batch_size": {"choice": [128, 256]}})
    (preset,) = opened(changed(space=space)).get_trials()
    assert preset.user_attrs == {ORIGIN: PRESET_IN_PART}
    assert "batch_size" not in preset.system_attrs["fixed_params"]


def open_together(folder, url, barrier, said) -> None:
    barrier.wait(30)
    try:
        with opened_store(url, folder) as store:
            said.put(len(open_study(CONFIG, store, name="twinkle", search=Search()).get_trials()))
    except Exception as error:
        said.put(repr(error))


@pytest.mark.slow
def test_machines_that_open_a_new_study_at_once_make_one_with_one_preset(
    opened, folder, database_url
):
    said, barrier = FORK.Queue(), FORK.Barrier(4)
    arguments = (folder, database_url, barrier, said)
    processes = [FORK.Process(target=open_together, args=arguments) for _ in range(4)]
    for process in processes:
        process.start()
    assert [said.get(timeout=60) for _ in processes] == [1] * 4
    for process in processes:
        process.join()
    trials = opened(url=database_url).get_trials()
    assert [trial.user_attrs for trial in trials] == [{ORIGIN: PRESET}]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"metric": "onset_f1", "seeds": (0, 1)}, "metric f1, not onset_f1"),
        (
            {"entry": {"n_timesteps": 1000, "policy": "MlpPolicy", "gamma": 0.8}},
            "entry.learning_rate 0.0003, not None",
        ),
        (
            {"space": Space({**CONFIG.space, "tau": {"float": [0.001, 0.2], "log": True}})},
            r"space.tau.float \[0.001, 0.1\], not \[0.001, 0.2\]",
        ),
    ],
)
def test_another_study_of_the_same_name_is_refused(other, message, opened):
    opened()
    with pytest.raises(RunError, match=f"Study 'twinkle' has {message}: expected the same"):
        opened(changed(**other))
    assert len(opened(changed(**other), name="other").get_trials()) == 1


def test_what_a_store_gives_back_in_another_type_is_the_same(opened):
    entry = {**CONFIG.entry, "policy_kwargs": {"net_arch": (64, 64)}}
    opened(changed(entry=entry))
    opened(changed(entry={**entry, "n_timesteps": 1000.0}))


@pytest.mark.parametrize(
    ("directions", "begun"),
    [(["minimize"], 1), (["maximize", "minimize"], 1), (["maximize"], 1), (["maximize"], 0)],
    ids=str,
)
def test_a_study_of_another_program_is_refused_one_just_begun_is_made_to_an_end(
    directions, begun, opened, folder, monkeypatch
):
    monkeypatch.setattr(storage, "_MAKING_SECONDS", 0.2)
    with opened_store(None, folder) as store:
        study = optuna.create_study(study_name="twinkle", storage=store, directions=directions)
        for _ in range(begun):
            study.ask()
    if begun:
        with pytest.raises(ConfigError, match="Study 'twinkle' is another program's: expected"):
            opened()
    else:
        assert [trial.user_attrs for trial in opened().get_trials()] == [{ORIGIN: PRESET}]


# The journal.


def fill_journal(opened, folder: StudyFolder) -> Path:
    study = opened()
    study.tell(study.ask(), 0.5)
    return folder.journal_file


@pytest.mark.parametrize("whole", [True, False], ids=["after lines", "alone"])
def test_half_a_line_of_a_killed_writer_is_mended_by_the_next_one(whole, opened, folder):
    file = fill_journal(opened, folder)
    lines = file.read_bytes() if whole else b""
    file.write_bytes(lines + b'{"op_code":5,"worker')
    study = opened()
    study.tell(study.ask(), 0.7)
    values = [trial.value for trial in opened().get_trials()]
    assert values == ([0.5, 0.7] if whole else [0.7])
    assert file.read_bytes().startswith(lines)


def write_much(folder: StudyFolder, barrier, name: str) -> None:
    barrier.wait(30)
    with opened_store(None, folder) as store:
        study = optuna.load_study(study_name="twinkle", storage=store)
        for number in range(30):
            study.set_user_attr(f"{name}-{number}", "x" * 5000)
    storage._JournalLock(folder).acquire()  # as if it were just writing
    os.kill(os.getpid(), signal.SIGKILL)


def test_many_processes_write_into_a_journal_and_may_be_killed(opened, folder):
    opened()
    barrier = FORK.Barrier(3)
    processes = [FORK.Process(target=write_much, args=(folder, barrier, n)) for n in "abc"]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert len(opened().user_attrs) == 1 + 3 * 30


@pytest.mark.parametrize("line", ["nonsense", "[1]", '{"op_code": 99}', '{"op_code": 0}'])
def test_a_journal_that_is_damaged_is_refused(line, opened, folder):
    file = fill_journal(opened, folder)
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:2], line, *lines[3:], ""]))
    with pytest.raises(RunError, match=f"'{file}' cannot be used .*: expected a journal of Optuna"):
        open_store(None, folder)
    with pytest.raises(RunError, match="journal.log' cannot be used .*Not a directory"):
        open_store(None, StudyFolder(file / "study"))


# Databases.


@tables("url, message")
def test_what_is_no_database_for_this_is_refused_without_its_password(url, message, folder):
    with pytest.raises(RunError, match=f"^Database .*{message}") as caught:
        open_store(url, folder)
    for secret in ("pass@", "word@", "=pass", "\n"):
        assert secret not in str(caught.value)


@tables("part, message")
def test_a_database_that_cannot_be_used_is_named(part, message, database_url, folder):
    execute(database_url, "DROP ROLE IF EXISTS guest", "CREATE ROLE guest LOGIN")
    url = sqlalchemy.make_url(database_url).set(**part).render_as_string()
    with pytest.raises(RunError, match=message):
        open_store(url, folder)


def execute(url: str, *statements: str) -> None:
    engine = sqlalchemy.create_engine(url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        for statement in statements:
            connection.execute(sqlalchemy.text(statement))
    engine.dispose()


def test_a_password_may_hold_any_character_and_tables_are_of_this_optuna(database_url, folder):
    url = database_url.replace("://postgres@", "://postgres:{a}%40{@")
    assert url != database_url
    open_store(url, folder)
    execute(database_url, "UPDATE alembic_version SET version_num = 'v2.6.0.a'")
    with pytest.raises(RunError, match="Database '.*' cannot be used: .*optuna storage upgrade"):
        open_store(url, folder)
