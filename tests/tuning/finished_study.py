"""Studies whose trials have run, with made-up results, through Optuna's own interface."""

from __future__ import annotations

import math

import optuna
from optuna.trial import TrialState

from sb3_piano.tuning import Space, StudyConfig
from sb3_piano.tuning import study as of_study

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"

SPACE = {
    "learning_rate": {"float": [1e-4, 1e-2], "log": True},
    "gamma": {"discount": [0.6, 0.97]},
    "batch_size": {"choice": [32, 64, 128]},
    "policy_kwargs.net_arch": {"choice": {"small": [16], "large": [32, 32]}},
}

ENTRY = {
    "env_kwargs": {"observation": "fingers", "physics": "fast"},
    "n_timesteps": 1000,
    "policy": "MlpPolicy",
    "policy_kwargs": {"net_arch": [16]},
    "learning_rate": 0.001,
    "batch_size": 32,
    "gamma": 0.8,
    "buffer_size": 1000,
    "replay_buffer_class": "importlib.import_module('sb3_piano.buffers').CompactReplayBuffer",
    "learning_starts": 100,
    "train_freq": 4,
    "monitor_kwargs": "dict(info_keywords=('precision', 'recall', 'f1', 'onset_f1'))",
    "callback": [{"sb3_piano.callbacks.F1Callback": {"eval_freq": 900}}],
}


def study_config(entry=ENTRY, space=SPACE, **changes):
    """A study of SAC on a debug piece, unless something is changed."""
    settings = {"algo": "sac", "env_id": ENV_ID, **changes}
    return StudyConfig(entry=entry, space=Space(space), **settings)


CONFIG = study_config()


def new_study(name="sac_twinkle"):
    sampler = optuna.samplers.RandomSampler(seed=0)
    return optuna.create_study(study_name=name, direction="maximize", sampler=sampler)


def begin(study, config=CONFIG, **noted):
    """Start a trial, as a worker does."""
    trial = study.ask()
    noted = {"host": "here", "folder": f"study/trials/{trial.number}", **noted}
    for name, value in noted.items():
        trial.set_user_attr(name, value)
    config.space.suggest(trial)
    return trial


def complete(study, value, config=CONFIG, **noted):
    """Run a trial up to a value, or a function of it; what else it scored follows from that."""
    trial = begin(study, config, steps=1000, **noted)
    value = value(trial) if callable(value) else value
    results = {"final_f1": value, "best_f1": value + 0.01, "final_onset_f1": value / 2}
    for name, result in {**results, "best_onset_f1": value / 2 + 0.01}.items():
        trial.set_user_attr(name, result)
    for part in range(1, 6):
        trial.report(value * part / 5, 200 * part)
    return study.tell(trial, value)


def by_learning_rate(trial):
    """Return a value that is the higher, the nearer the learning rate is to 0.001."""
    return 1 / (1 + abs(math.log(trial.params["learning_rate"] / 1e-3)))


def complete_preset(study, value, config=CONFIG):
    """Run the trial that has the settings of the study's entry."""
    study.enqueue_trial(config.preset_params(), user_attrs={of_study.ORIGIN: of_study.PRESET})
    return complete(study, value, config)


def prune(study, value, config=CONFIG):
    """Run a trial that reports a value once, and is pruned."""
    trial = begin(study, config, steps=200)
    trial.report(value, 200)
    return study.tell(trial, state=TrialState.PRUNED)


def fail(study, reason=None, config=CONFIG):
    """Run a trial that fails with a reason, or whose process is gone."""
    trial = begin(study, config)
    if reason is not None:
        trial.set_user_attr(of_study.FAILURE, reason)
    return study.tell(trial, state=TrialState.FAIL)


def lose(study, config=CONFIG):
    """Run a trial whose process goes, and queue its settings again."""
    trial = begin(study, config)
    trial.report(0.5, 200)
    of_study.retry(study, study.tell(trial, state=TrialState.FAIL))


def finished_study(config=CONFIG, n_complete=24):
    """A study with trials of all kinds, the preset's first."""
    study = new_study()
    complete_preset(study, 0.41, config)
    for number in range(1, n_complete):
        complete(study, by_learning_rate, config)
        if number % 4 == 0:
            prune(study, 0.02 * number, config)
    fail(study, "RunError: final_f1 is nan: expected a number.", config)
    fail(study, None, config)
    begin(study, config)
    study.enqueue_trial({})
    return study
