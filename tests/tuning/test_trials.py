"""Which trials count, and which are run again: those whose process was gone, some times."""

from __future__ import annotations

import pytest
from finished_study import (
    CONFIG,
    begin,
    complete,
    complete_preset,
    fail,
    finished_study,
    lose,
    new_study,
    prune,
)
from optuna.exceptions import ExperimentalWarning
from optuna.trial import TrialState

from sb3_piano.tuning.trials import (
    ORIGIN,
    PRESET,
    best_first,
    counting,
    failure_of,
    preset_trial,
    repeated,
    summary,
)


@pytest.fixture
def study():
    return new_study()


def test_settings_of_a_trial_whose_process_was_gone_are_queued_with_its_origin(study, recwarn):
    study.enqueue_trial({"batch_size": 64}, user_attrs={ORIGIN: PRESET})
    lose(study)
    lost, again = study.trials
    assert failure_of(lost).startswith("its process ended: ")
    assert (again.state, again.params) == (TrialState.WAITING, lost.params)
    assert (again.user_attrs, again.intermediate_values) == ({ORIGIN: PRESET}, {})
    assert repeated(study.trials) == {0}
    trial = begin(study)
    assert (trial.number, trial.params) == (1, lost.params)
    assert [trial.number for trial in counting(study)] == [1]
    assert not [found for found in recwarn if issubclass(found.category, ExperimentalWarning)]


def test_settings_are_tried_four_times_and_then_count_as_failed(study):
    for _ in range(4):
        lose(study)
    assert [trial.state for trial in study.trials] == [TrialState.FAIL] * 4
    assert [trial.number for trial in counting(study)] == [3]
    assert len({trial.params["learning_rate"] for trial in study.trials}) == 1


def test_the_best_trial_is_the_complete_one_with_the_highest_value_the_first_of_equals(study):
    complete_preset(study, 0.0)
    assert best_first(study.trials)[0].value == 0.0
    complete(study, 0.3)
    prune(study, 0.9)
    complete(study, 0.5)
    complete(study, 0.5)
    begin(study).report(0.99, 200)
    assert [trial.number for trial in best_first(study.trials)] == [3, 4, 1, 0]
    assert best_first(study.trials)[0].number == study.best_trial.number  # Optuna's own view
    assert preset_trial(study.trials).number == 0
    assert CONFIG.space.settings(preset_trial(study.trials).params)["gamma"] == 0.8
    assert fail(study, "ValueError: no").state is TrialState.FAIL
    assert failure_of(study.trials[-1]) == "ValueError: no"


def test_a_summary_says_how_many_trials_there_are_and_how_good():
    study = finished_study(n_complete=6)
    text = summary(counting(study), "final f1")
    assert text.startswith("9 trials (1 running, 1 pruned, 2 failed), highest final f1 0.")
    assert summary([], "final f1") == "0 trials"
    assert {trial.state for trial in study.trials} == set(TrialState)
