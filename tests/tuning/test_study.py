"""What a study is: its settings, what makes two the same, and how it is searched."""

from __future__ import annotations

import warnings
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState
from small_study import small_study

from sb3_piano.exceptions import ConfigError
from sb3_piano.tuning.study import Search, StudyConfig, make_pruner, make_sampler

MIDI_FILE = Path(__file__).parents[1] / "data" / "five_fingers.mid"


@pytest.mark.parametrize("option", ["score", "fingering"])
def test_a_file_counts_by_its_content(option, tmp_path):
    copy = tmp_path / "elsewhere.mid"
    copy.write_bytes(MIDI_FILE.read_bytes())
    here, there = (small_study(entry={"env_kwargs": {option: str(f)}}) for f in (MIDI_FILE, copy))
    assert here.identity() == there.identity()
    copy.write_bytes(b"other")
    assert here.identity() != there.identity()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"metric": "f2"}, "metric is 'f2': expected one of 'f1', 'onset_f1'"),
        ({"objective": "last"}, "objective is 'last': expected one of 'final', 'best'"),
        ({"seeds": ()}, "seeds are"),
        ({"seeds": (1, 1)}, "seeds are"),
        ({"seeds": (-1,)}, r"seeds\[0\] is -1: expected a whole number, 0 or more"),
        ({"seeds": (3,), "eval_seed": 3}, "eval_seed is 3: expected one or more"),
        ({"eval_episodes": 0}, "eval_episodes is 0"),
        ({"n_evaluations": 41}, "n_evaluations is 41, in 40 steps"),
        ({"minutes": 0.0}, "minutes is 0.0: expected a finite number above 0"),
    ],
)
def test_a_setting_out_of_range_is_refused(setting, message):
    with pytest.raises(ConfigError, match=message):
        small_study(**setting)


# Samplers and pruners by name, on studies whose objective is a parabola.

STEPS = 100


def config(n_evaluations: int = 5, seeds: tuple[int, ...] = (0,)) -> StudyConfig:
    return small_study(entry={"n_timesteps": STEPS}, n_evaluations=n_evaluations, seeds=seeds)


def steps_of(study_config: StudyConfig) -> list[int]:
    total = STEPS * len(study_config.seeds)
    interval = STEPS // study_config.n_evaluations
    return list(range(interval, total + 1, interval))


def parabola(study_config: StudyConfig):
    """Return an objective whose best settings are x = 0.5 and the label b."""

    def objective(trial: optuna.Trial) -> float:
        x = trial.suggest_float("x", -4.0, 4.0)
        y = trial.suggest_float("y", 1e-5, 1e-1, log=True)
        value = -((x - 0.5) ** 2) - (trial.suggest_categorical("label", ["a", "b"]) == "a") - y
        for step in steps_of(study_config):
            trial.report(value * (1 + 1 / step), step)
            if step < steps_of(study_config)[-1] and trial.should_prune():
                raise optuna.TrialPruned
        return value

    return objective


def study_of(search: Search, study_config: StudyConfig, name: str = "study") -> optuna.Study:
    return optuna.create_study(
        direction="maximize",
        study_name=name,
        sampler=make_sampler(search),
        pruner=make_pruner(search, study_config),
    )


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
        study.optimize(parabola(config()), n_trials=9)
    assert {trial.state for trial in study.trials} <= {TrialState.COMPLETE, TrialState.PRUNED}
    assert len({trial.params["x"] for trial in study.trials}) == 9
    assert [record for record in caplog.records if record.levelname != "INFO"] == []


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["tpe", "cmaes", "gp"])
def test_the_first_trials_are_random_and_no_more(sampler):
    def first_params(startup_trials: int) -> list[dict]:
        search = Search(sampler=sampler, pruner="none", startup_trials=startup_trials, seed=3)
        study = study_of(search, config())
        study.optimize(parabola(config()), n_trials=6)
        return [trial.params for trial in study.trials]

    random, learning = first_params(20), first_params(4)
    assert random[:4] == learning[:4]
    assert random[4] != learning[4]


def told(study: optuna.Study, study_config: StudyConfig, value: float) -> int | None:
    """Run a trial that always has one value; return the step at which it was pruned, if any."""
    trial = study.ask()
    for step in steps_of(study_config):
        trial.report(value, step)
        if trial.should_prune():
            study.tell(trial, state=TrialState.PRUNED)
            return step
    study.tell(trial, value)
    return None


def rising(study: optuna.Study, study_config: StudyConfig, count: int) -> None:
    """Run good trials, each better than the one before, so that none of them is pruned."""
    for number in range(count):
        assert told(study, study_config, 0.5 + 0.01 * number) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pruner", "n_evaluations", "seeds", "steps"),
    [
        ("median", 5, (0,), {40}),
        ("median", 5, (0, 1, 2), {40}),
        ("median", 2, (0,), {100}),
        ("median", 1, (0, 1, 2), {100}),
        ("halving", 5, (0,), {40}),
        ("halving", 1, (0, 1, 2), {100}),
        ("hyperband", 5, (0,), {20, 60}),
        ("hyperband", 5, (0, 1, 2), {20, 60, 180}),
        ("none", 5, (0,), {None}),
    ],
)
def test_a_bad_trial_is_pruned_at_the_first_evaluation_that_counts(
    pruner, n_evaluations, seeds, steps
):
    study_config = config(n_evaluations, seeds)
    study = study_of(Search(pruner=pruner), study_config)
    rising(study, study_config, 20)  # hyperband shares them out among its brackets
    assert {told(study, study_config, 0.1) for _ in range(20)} == steps


@pytest.mark.slow
def test_the_median_needs_half_of_the_startup_trials_to_be_complete():
    study = study_of(Search(startup_trials=6), config())
    rising(study, config(), 2)
    assert told(study, config(), 0.1) is None
    assert told(study, config(), 0.05) == 40


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sampler": "tpes"}, "sampler is 'tpes': expected one of 'tpe', .* Did you mean 'tpe'?"),
        ({"pruner": "Median"}, "pruner is 'Median': expected one of .* Did you mean 'median'?"),
        ({"startup_trials": 0}, "startup_trials is 0: expected a whole number, 1 or more."),
        ({"seed": -1}, "seed is -1: expected a whole number, 0 or more."),
    ],
)
def test_a_search_with_an_impossible_setting_is_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        Search(**settings)
