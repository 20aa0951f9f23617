"""What a trial is: real trainings, a few steps long, judged and reported."""

from __future__ import annotations

import dataclasses
import json
import platform
import re

import optuna
import pytest
import small_study
from optuna.trial import TrialState
from yaml_rows import Tables

from sb3_piano.callbacks import F1Callback
from sb3_piano.training import RunFolder, evaluate
from sb3_piano.tuning import Objective, Space, StudyFolder
from sb3_piano.tuning.study import METRICS

tables = Tables(__file__)

small = small_study.small_study


class PruneAt(optuna.pruners.BasePruner):
    """Prune when a value is reported at this step."""

    def __init__(self, step):
        self._step = step

    def prune(self, study, trial):
        return trial.last_step == self._step


def run(config, folder, n_trials=1, pruner=None):
    """Run trials of a study in this process and return them."""
    study = optuna.create_study(
        direction="maximize",
        sampler=optuna.samplers.RandomSampler(seed=0),
        pruner=pruner or optuna.pruners.NopPruner(),
    )
    objective = Objective(config, StudyFolder(folder))
    study.optimize(objective, n_trials=n_trials, catch=(Exception,))
    return study.trials


@pytest.mark.slow
def test_each_trial_trains_with_its_settings_in_a_run_of_its_own(tmp_path):
    space = {
        "gamma": {"float": [0.7, 0.9]},
        "batch_size": {"choice": [4, 8]},
        "policy_kwargs.net_arch": {"choice": {"one": [4], "two": [4, 4]}},
        "env_kwargs.n_steps_lookahead": {"int": [0, 2]},
    }
    saving = {"save_freq": 10, "save_path": str(tmp_path / "saved")}
    judging = {"sb3_piano.callbacks.OnsetF1Callback": {"eval_freq": 5}}
    callback = [judging, {"stable_baselines3.common.callbacks.CheckpointCallback": saving}]
    config = small(Space(space), {"callback": callback})
    for trial in run(config, tmp_path, n_trials=2):
        used = RunFolder.open(tmp_path / "trials" / str(trial.number) / "seed_0").read_config()
        settings = config.space.settings(trial.params)
        assert used.algorithm_kwargs["gamma"] == trial.params["gamma"] == settings["gamma"]
        assert used.algorithm_kwargs["batch_size"] == trial.params["batch_size"]
        assert used.algorithm_kwargs["policy_kwargs"] == {
            "net_arch": settings["policy_kwargs.net_arch"]
        }
        lookahead = settings["env_kwargs.n_steps_lookahead"]
        assert used.env_kwargs == {"n_steps_lookahead": lookahead, "physics": "fast"}
        assert used.seed == 0
        assert used.n_timesteps == trial.user_attrs["steps"] == 40
        assert trial.user_attrs["host"] == platform.node()
        assert trial.user_attrs["folder"] == str(tmp_path / "trials" / str(trial.number))
        assert (tmp_path / f"trials/{trial.number}/seed_0/model.zip").is_file()
        assert not (tmp_path / f"trials/{trial.number}/seed_0/checkpoint").exists()
        # Of the entry's callbacks those that evaluate are left out.
        assert not (tmp_path / f"trials/{trial.number}/seed_0/best_onset_f1").exists()
    assert len(list((tmp_path / "saved").iterdir())) == 4


@pytest.mark.slow
def test_its_value_is_what_evaluation_of_the_model_at_the_end_found(tmp_path):
    config = small(metric="onset_f1", eval_seed=7, eval_episodes=2)
    (trial,) = run(config, tmp_path, pruner=PruneAt(40))  # too late: it is through
    assert trial.state is TrialState.COMPLETE
    saved = json.loads((tmp_path / "trials/0/seed_0/evaluation/metrics.json").read_text())
    assert saved["episode_seeds"] == [7, 7]
    assert trial.value == saved["mean"]["onset_f1"] == trial.user_attrs["final_onset_f1"]
    assert trial.user_attrs["final_f1"] == saved["mean"]["f1"]
    assert trial.user_attrs["best_f1"] >= saved["mean"]["f1"]


@pytest.mark.slow
def test_each_of_several_pieces_is_judged_as_often_as_at_the_end(tmp_path):
    pieces = ["debug-CMajorScaleOneHand", "debug-DMajorScaleOneHand"]
    entry = {"pieces": pieces, "env_wrapper": {"sb3_piano.wrappers.Excerpt": {"length": 0.2}}}
    config = small(entry=entry, eval_episodes=2, env_id="RoboPianist-v0")
    judged = []

    class Judge(F1Callback):
        def _log_success_callback(self, locals_, globals_):
            super()._log_success_callback(locals_, globals_)
            judged.append(locals_["done"])

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(METRICS, "f1", Judge)
        run(config, tmp_path)
    assert sum(judged) == 2 * 2 * 2  # evaluations, pieces, episodes


@pytest.mark.slow
def test_the_best_model_may_count_in_place_of_the_last(tmp_path):
    config = small(objective="best", entry={"learning_rate": 0.1}, n_evaluations=4)
    (trial,) = run(config, tmp_path)
    note = json.loads((tmp_path / "trials/0/seed_0/best_f1/best_model.json").read_text())
    # the best of the evaluations during training, and the model at the end
    assert trial.value == max(note["value"], trial.user_attrs["final_f1"])
    assert list(trial.intermediate_values) == [10, 20, 30, 40]
    reported = list(trial.intermediate_values.values())
    assert reported == sorted(reported)


@pytest.mark.slow
def test_a_value_is_reported_at_each_evaluation_and_the_mean_over_seeds_so_far(tmp_path):
    (trial,) = run(small(seeds=(3, 5)), tmp_path)
    assert list(trial.intermediate_values) == [20, 40, 60, 80]
    finals = [
        json.loads((tmp_path / f"trials/0/seed_{seed}/evaluation/metrics.json").read_text())
        for seed in (3, 5)
    ]
    values = [saved["mean"]["f1"] for saved in finals]
    assert trial.user_attrs["values"] == values
    assert trial.intermediate_values[40] == values[0]
    assert trial.value == trial.intermediate_values[80] == pytest.approx(sum(values) / 2)
    assert trial.user_attrs["steps"] == 80
    within = json.loads((tmp_path / "trials/0/seed_5/best_f1/best_model.json").read_text())
    assert trial.intermediate_values[60] <= (values[0] + within["value"]) / 2


@pytest.mark.slow
@pytest.mark.parametrize("step", [40, 60], ids=["between seeds", "within a training"])
def test_a_pruned_trial_ends_there(tmp_path, step):
    (trial,) = run(small(seeds=(0, 1)), tmp_path, pruner=PruneAt(step))
    assert trial.state is TrialState.PRUNED
    assert trial.user_attrs["steps"] == step
    assert len(trial.user_attrs["values"]) == 1
    assert trial.value == trial.intermediate_values[step]
    assert (tmp_path / "trials/0/seed_1").exists() == (step > 40)


HANDS = {
    "env_kwargs": {"observation": "hands", "physics": "fast"},
    "env_wrapper": ["sb3_piano.wrappers.HandActions", "sb3_piano.wrappers.HandReward"],
    "vec_env_wrapper": "sb3_piano.vec_env.HandsAsAgents",
}


@pytest.mark.slow
@pytest.mark.parametrize("entry", [{"n_envs": 4}, {"n_envs": 2, **HANDS}])
def test_where_there_are_several_environments_or_agents_evaluations_are_as_many(tmp_path, entry):
    (trial,) = run(small(entry=entry), tmp_path)
    assert list(trial.intermediate_values) == [20, 40]


@pytest.mark.slow
def test_a_trial_ends_when_its_time_is_over(tmp_path):
    config = small(minutes=1e-4, seeds=(0, 1), entry={"n_timesteps": 100_000})
    (trial,) = run(config, tmp_path)
    assert trial.state is TrialState.COMPLETE
    assert trial.user_attrs["steps"] < 1000
    assert len(trial.user_attrs["values"]) == 2
    assert list(trial.intermediate_values) == [100_000, 200_000]


@pytest.mark.slow
@tables("name, choices, reason")
def test_a_trial_that_fails_says_why_and_the_study_goes_on(name, choices, reason, tmp_path):
    config = small(
        Space({name: {"choice": choices}}), small_study.wrapped(small_study.Broken, limit=1e9)
    )
    study = optuna.create_study(direction="maximize")
    for choice in choices:
        study.enqueue_trial({name: choice})
    study.optimize(Objective(config, StudyFolder(tmp_path)), n_trials=2, catch=(Exception,))
    good, bad = study.trials
    assert good.state is TrialState.COMPLETE
    assert bad.state is TrialState.FAIL
    assert re.search(reason, bad.user_attrs["failure"])


@pytest.mark.slow
@pytest.mark.parametrize("when", ["training", "last evaluation"])
def test_a_trial_that_is_interrupted_has_no_value(tmp_path, when, monkeypatch, ctrl_c):
    def interrupted(*arguments):
        return dataclasses.replace(evaluate(*arguments), interrupted=True)

    entry = {"env_wrapper": {"acting.AtStep": {"step": 30}}} if when == "training" else {}
    if when != "training":
        monkeypatch.setattr("sb3_piano.tuning.objective.evaluate", interrupted)
    study = optuna.create_study(direction="maximize")
    with pytest.raises(KeyboardInterrupt):
        study.optimize(Objective(small(entry=entry), StudyFolder(tmp_path)), n_trials=1)
    assert study.trials[0].state is TrialState.FAIL
    assert not list(tmp_path.glob("trials/0/seed_0/checkpoint"))
