"""Which trials count, and which are run again: those whose process was gone, exactly once."""

from __future__ import annotations

import optuna
import pytest
from finished_study import (
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
from optuna.exceptions import ExperimentalWarning
from optuna.trial import TrialState

from sb3_piano.tuning.trials import (
    FAILURE,
    GONE,
    ORIGIN,
    PRESET,
    best_trial,
    counting,
    failure_of,
    preset_trial,
    repeated,
    requeue_lost,
    summary,
)

CONFIG = study_config()


@pytest.fixture
def study():
    return new_study()


def requeue(study):
    requeue_lost(study, lambda trial: True)


def test_settings_of_a_trial_whose_process_was_gone_are_queued_once(study, recwarn):
    begin(study, CONFIG).report(0.5, 200)
    for _ in range(2):
        requeue(study)
    lost, again = study.trials
    assert (lost.state, failure_of(lost)) == (TrialState.FAIL, GONE)
    assert (again.state, again.params) == (TrialState.WAITING, lost.params)
    assert (again.user_attrs, again.intermediate_values) == ({}, {})
    assert repeated(study.trials) == {0}
    trial = begin(study, CONFIG)
    assert (trial.number, trial.params) == (1, lost.params)
    assert [trial.number for trial in counting(study)] == [1]
    assert not [found for found in recwarn if issubclass(found.category, ExperimentalWarning)]


def test_settings_that_were_not_drawn_yet_are_queued_as_far_as_they_are_fixed(study):
    study.enqueue_trial({"batch_size": 64}, user_attrs={ORIGIN: PRESET})
    study.ask()
    requeue(study)
    trial = begin(study, CONFIG)
    assert trial.params["batch_size"] == 64
    assert trial.user_attrs[ORIGIN] == PRESET


def test_other_trials_are_left_alone(study):
    complete(study, CONFIG, 0.5)
    prune(study, CONFIG, 0.1)
    fail(study, CONFIG, "ValueError: no")
    study.enqueue_trial({"batch_size": 64})
    begin(study, CONFIG)
    fail(study, CONFIG, None)
    before = study.trials
    requeue_lost(study, lambda trial: False)  # another machine's
    requeue_lost(study, lambda trial: trial.number < 3)
    assert study.trials == before
    assert len(counting(study)) == len(before)


def test_settings_are_tried_four_times_and_then_count_as_failed_interruptions_are_no_retries(study):
    for _ in range(5):
        interrupt(study, CONFIG)
        requeue(study)
    for _ in range(4):
        begin(study, CONFIG)
        requeue(study)
    assert [trial.state for trial in study.trials] == [TrialState.FAIL] * 9
    assert [trial.number for trial in counting(study)] == [8]
    assert len({trial.params["learning_rate"] for trial in study.trials}) == 1


def test_the_best_trial_is_the_complete_one_with_the_highest_value_the_first_of_equals(study):
    complete(study, CONFIG, 0.3)
    prune(study, CONFIG, 0.9)
    complete(study, CONFIG, 0.5)
    complete(study, CONFIG, 0.5)
    begin(study, CONFIG).report(0.99, 200)
    assert best_trial(study).number == 2
    assert best_trial(study).number == study.best_trial.number  # Optuna's own view


def test_a_best_value_of_zero_is_one_and_the_presets_trial_is_known_by_its_origin(study):
    complete_preset(study, CONFIG, 0.0)
    assert best_trial(study).value == 0.0
    complete(study, CONFIG, 0.3)
    assert preset_trial(study).number == 0
    assert CONFIG.space.settings(preset_trial(study).params)["gamma"] == 0.8


def test_a_summary_says_how_many_trials_there_are_and_how_good():
    study = finished_study(CONFIG, n_complete=6)
    text = summary(counting(study), "final f1")
    assert text.startswith("9 trials (1 running, 1 pruned, 2 failed), highest final f1 0.")
    assert summary([], "final f1") == "0 trials"
    assert {trial.state for trial in study.trials} == set(optuna.trial.TrialState)
    assert FAILURE in study.trials[7].user_attrs
