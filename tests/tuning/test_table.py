"""The CSV file of all trials."""

from __future__ import annotations

import csv

import optuna
import pytest
from finished_study import (
    SPACE,
    begin,
    complete,
    complete_preset,
    fail,
    finished_study,
    interrupt,
    new_study,
    prune,
    study_config,
)

from sb3_piano.tuning.report import write_table
from sb3_piano.tuning.store.orphans import requeue
from sb3_piano.tuning.study import StudyFolder


@pytest.fixture
def rows_of(tmp_path):
    """Return a function that writes the table of a study and reads it again."""

    def read(study, config):
        file = write_table(study, config, StudyFolder(tmp_path))
        assert file == tmp_path / "trials.csv"
        return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))

    return read


def test_a_row_holds_what_a_trial_scored_took_and_had_as_settings(rows_of):
    config, study = study_config(), new_study()
    complete(study, config, 0.25)
    (row,) = rows_of(study, config)
    settings = config.space.settings(study.trials[0].params)
    assert float(row.pop("learning_rate")) == settings["learning_rate"]
    assert float(row.pop("gamma")) == settings["gamma"] > 0.5  # not its distance from 1
    assert int(row.pop("batch_size")) == settings["batch_size"]
    assert row.pop("policy_kwargs.net_arch") == str(settings["policy_kwargs.net_arch"])
    assert row == {
        **{"number": "0", "state": "complete", "value": "0.25", "final_f1": "0.25"},
        **{"best_f1": "0.26", "final_onset_f1": "0.125", "best_onset_f1": "0.135"},
        **{"steps": "1000", "seconds": "2.5", "origin": "", "failure": "", "host": "here"},
        "folder": "study/trials/0",
    }


def test_states_reasons_and_origins_are_told(rows_of):
    config, study = study_config(), new_study()
    complete_preset(study, config, 0.5)
    prune(study, config, 0.125)
    fail(study, config, 'RuntimeError: "nan",\nagain')
    fail(study, config)
    interrupt(study, config)
    begin(study, config)
    study.ask()  # has no settings yet
    study.enqueue_trial({"batch_size": 64})
    rows = rows_of(study, config)
    assert [row["number"] for row in rows] == [*map(str, range(8))]
    told = [(row["state"], row["value"], row["origin"]) for row in rows]
    assert told == [
        ("complete", "0.5", "preset"),
        ("pruned", "0.125", ""),
        ("failed", "", ""),
        ("failed", "", ""),
        ("repeated", "", ""),
        ("running", "", ""),
        ("running", "", ""),
        ("waiting", "", ""),
    ]
    assert "nan" in rows[2]["failure"]
    assert rows[3]["failure"] == ""
    assert rows[0]["gamma"] == "0.8"
    assert rows[5]["gamma"] != rows[6]["gamma"] == ""


def test_a_trial_whose_worker_was_gone_is_repeated_once_it_is_queued_again(rows_of):
    config, study = study_config(), new_study()
    begin(study, config)
    requeue(study, study.trials[0])
    rows = rows_of(study, config)
    assert [row["state"] for row in rows] == ["repeated", "waiting"]
    complete(study, config, 0.5)
    first, second = rows_of(study, config)
    assert second["state"] == "complete"
    for name in SPACE:
        assert first[name] == second[name] != ""


def test_the_table_is_written_anew_and_empty_for_an_empty_study(rows_of):
    config, study = study_config(), new_study()
    assert rows_of(study, config) == []
    complete(study, config, 0.0)
    assert [row["value"] for row in rows_of(study, config)] == ["0.0"]
    assert len(rows_of(finished_study(config), config)) == 34


def test_settings_that_a_trial_lacks_are_left_empty(rows_of):
    config, study = study_config(), new_study()
    distribution = config.space.distributions["batch_size"]
    study.add_trial(
        optuna.create_trial(
            value=0.5, params={"batch_size": 64}, distributions={"batch_size": distribution}
        )
    )
    (row,) = rows_of(study, config)
    assert (row["batch_size"], row["learning_rate"], row["steps"]) == ("64", "", "")
