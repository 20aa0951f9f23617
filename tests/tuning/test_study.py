"""What a study is: its settings, what makes two the same, and how it is searched."""

from __future__ import annotations

import warnings
from pathlib import Path

import optuna
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
from optuna.distributions import CategoricalDistribution, FloatDistribution
from optuna.exceptions import ExperimentalWarning
from optuna.trial import TrialState
from small_study import small_study
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.tuning import study as of_study
from sb3_piano.tuning.study import ORIGIN, PRESET, Search, StudyConfig, make_pruner, make_sampler

tables = Tables(__file__)

MIDI_FILE = Path(__file__).parents[1] / "data" / "five_fingers.mid"


@pytest.mark.parametrize("option", ["score", "fingering"])
def test_a_file_counts_by_its_content(option, tmp_path):
    copy = tmp_path / "elsewhere.mid"
    copy.write_bytes(MIDI_FILE.read_bytes())
    here, there = (small_study(entry={"env_kwargs": {option: str(f)}}) for f in (MIDI_FILE, copy))
    assert here.identity() == there.identity()
    copy.write_bytes(b"other")
    assert here.identity() != there.identity()


@tables("make, setting, message")
def test_a_setting_out_of_range_is_refused(make, setting, message):
    setting = {k: tuple(v) if isinstance(v, list) else v for k, v in setting.items()}
    with pytest.raises(ConfigError, match=message):
        {"study": small_study, "search": Search}[make](**setting)


# Samplers and pruners by name, on trials whose values are made up.

STEPS = 100
SPACE = {"x": FloatDistribution(-4.0, 4.0), "label": CategoricalDistribution(["a", "b"])}


def config(n_evaluations: int = 5, seeds: tuple[int, ...] = (0,)) -> StudyConfig:
    return small_study(entry={"n_timesteps": STEPS}, n_evaluations=n_evaluations, seeds=seeds)


def study_of(search: Search, of: StudyConfig) -> optuna.Study:
    parts = {"sampler": make_sampler(search), "pruner": make_pruner(search, of)}
    return optuna.create_study(direction="maximize", study_name="study", **parts)


def told(study: optuna.Study, of: StudyConfig, value=None) -> int | None:
    """Run a trial that always has one value; return the step at which it was pruned, if any."""
    trial = study.ask(SPACE)
    value = -((trial.params["x"] - 0.5) ** 2) if value is None else value
    interval = STEPS // of.n_evaluations
    for step in range(interval, STEPS * len(of.seeds) + 1, interval):
        trial.report(value, step)
        if trial.should_prune():
            study.tell(trial, state=TrialState.PRUNED)
            return step
    study.tell(trial, value)
    return None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sampler", "pruner"),
    [("tpe", "median"), ("cmaes", "hyperband"), ("gp", "halving"), ("random", "none")],
)
def test_a_sampler_and_a_pruner_run_a_study_without_a_warning(sampler, pruner, caplog):
    search = Search(sampler=sampler, pruner=pruner, startup_trials=3, seed=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        study = study_of(search, config())
        for _ in range(9):
            told(study, config())
    assert len({trial.params["x"] for trial in study.trials}) == 9
    assert [record for record in caplog.records if record.levelname != "INFO"] == []


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["tpe", "cmaes", "gp"])
def test_the_first_trials_are_random_and_no_more(sampler):
    def first_params(startup_trials: int) -> list[dict]:
        search = Search(sampler=sampler, pruner="none", startup_trials=startup_trials, seed=3)
        study = study_of(search, config())
        for _ in range(6):
            told(study, config())
        return [trial.params for trial in study.trials]

    random, learning = first_params(20), first_params(4)
    assert random[:4] == learning[:4]
    assert random[4] != learning[4]


def rising(study: optuna.Study, of: StudyConfig, count: int) -> None:
    """Run good trials, each better than the one before, so that none of them is pruned."""
    for number in range(count):
        assert told(study, of, 0.5 + 0.01 * number) is None


@pytest.mark.slow
@tables("pruner, n_evaluations, seeds, steps")
def test_a_bad_trial_is_pruned_at_the_first_evaluation_that_counts(
    pruner, n_evaluations, seeds, steps
):
    of = config(n_evaluations, tuple(seeds))
    study = study_of(Search(pruner=pruner), of)
    rising(study, of, 20)  # hyperband shares them out among its brackets
    assert {told(study, of, 0.1) for _ in range(20)} == {*steps}


@pytest.mark.slow
def test_the_median_needs_half_of_the_startup_trials_to_be_complete():
    study = study_of(Search(startup_trials=6), config())
    rising(study, config(), 2)
    assert told(study, config(), 0.1) is None
    assert told(study, config(), 0.05) == 40


# Which trials count, and which are run again: those whose process was gone, some times.


@pytest.fixture
def study():
    return new_study()


def test_settings_of_a_trial_whose_process_was_gone_are_queued_with_its_origin(study, recwarn):
    study.enqueue_trial({"batch_size": 64}, user_attrs={ORIGIN: PRESET})
    lose(study)
    lost, again = study.trials
    assert of_study.failure_of(lost).startswith("its process ended: ")
    assert (again.state, again.params) == (TrialState.WAITING, lost.params)
    assert (again.user_attrs, again.intermediate_values) == ({ORIGIN: PRESET}, {})
    assert of_study.repeated(study.trials) == {0}
    trial = begin(study)
    assert (trial.number, trial.params) == (1, lost.params)
    assert [trial.number for trial in of_study.counting(study)] == [1]
    assert not [found for found in recwarn if issubclass(found.category, ExperimentalWarning)]


def test_settings_are_tried_four_times_and_then_count_as_failed(study):
    for _ in range(4):
        lose(study)
    assert [trial.state for trial in study.trials] == [TrialState.FAIL] * 4
    assert [trial.number for trial in of_study.counting(study)] == [3]
    assert len({trial.params["learning_rate"] for trial in study.trials}) == 1


def test_the_best_trial_is_the_complete_one_with_the_highest_value_the_first_of_equals(study):
    complete_preset(study, 0.0)
    assert of_study.best_first(study.trials)[0].value == 0.0
    complete(study, 0.3)
    prune(study, 0.9)
    complete(study, 0.5)
    complete(study, 0.5)
    begin(study).report(0.99, 200)
    assert [trial.number for trial in of_study.best_first(study.trials)] == [3, 4, 1, 0]
    assert of_study.best_first(study.trials)[0].number == study.best_trial.number
    assert of_study.preset_trial(study.trials).number == 0
    assert CONFIG.space.settings(of_study.preset_trial(study.trials).params)["gamma"] == 0.8
    assert fail(study, "ValueError: no").state is TrialState.FAIL
    assert of_study.failure_of(study.trials[-1]) == "ValueError: no"


def test_a_summary_says_how_many_trials_there_are_and_how_good():
    study = finished_study(n_complete=6)
    text = of_study.summary(of_study.counting(study), "final f1")
    assert text.startswith("9 trials (1 running, 1 pruned, 2 failed), highest final f1 0.")
    assert of_study.summary([], "final f1") == "0 trials"
    assert {trial.state for trial in study.trials} == set(TrialState)
