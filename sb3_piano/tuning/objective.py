"""What a study maximises: how well models play that were trained with a trial's settings."""

from __future__ import annotations

import dataclasses
import math
import platform
import shutil
import time
from collections.abc import Callable, Mapping

import numpy as np
import optuna
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import MetricEvalCallback
from sb3_piano.exceptions import RunError
from sb3_piano.training import Plugin, RunConfig, RunFolder, entry_config, evaluate, train
from sb3_piano.training.configuration.names import import_name
from sb3_piano.tuning import attributes
from sb3_piano.tuning.attributes import result_name
from sb3_piano.tuning.reporting import AfterEvaluation, TimeLimit
from sb3_piano.tuning.study_config import METRICS, StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder


class TrialInterrupted(KeyboardInterrupt):
    """Someone stopped the training of a trial, which is to be run again."""


class Objective:
    """Train with the settings of a trial from each seed of the study, and judge the models.

    Each training is a run like any other, in ``trials/<number>/seed_<seed>`` of the study's folder,
    without its checkpoint. It is evaluated at equal distances by ``F1Callback`` or
    ``OnsetF1Callback`` and, when it has ended, by :func:`~sb3_piano.training.evaluate`; the trial
    may be pruned after each. What is reported is the mean of the value so far and the values of the
    trainings before, by the environment steps of all of them. Evaluating callbacks of the study's
    entry are left out.

    The function is for ``study.optimize(..., catch=(Exception,))``: whatever goes wrong is noted
    with the trial and raised.

    Args:
        config: The study.
        folder: Where its runs are kept.
        worker: The name by which others know whether this process is alive, if there are any.
        on_start: Is called when a trial has noted who runs it and what its settings are.
    """

    def __init__(
        self,
        config: StudyConfig,
        folder: StudyFolder,
        worker: str | None = None,
        on_start: Callable[[], object] = lambda: None,
    ):
        self.config = config
        self.folder = folder
        self.worker = worker
        self.on_start = on_start

    def __call__(self, trial: optuna.Trial) -> float:
        """Run a trial and return its value.

        Raises:
            optuna.TrialPruned: If the study's pruner ends it early.
            TrialInterrupted: If Ctrl-C or SIGTERM ended a training.
            Exception: Whatever a training or an evaluation raises, with the reason noted.
        """
        started = time.monotonic()
        progress = _Progress(self.config, trial)
        try:
            if self.worker is not None:
                trial.set_user_attr(attributes.WORKER, self.worker)
            trial.set_user_attr(attributes.HOST, platform.node())
            trial.set_user_attr(attributes.FOLDER, str(self.folder.trial_dir(trial.number)))
            settings = self.config.space.suggest(trial)
            self.on_start()
            entry = self.config.space.apply(self.config.entry, settings)
            config = _without_evaluations(entry_config(self.config.algo, self.config.env_id, entry))
            for seed in self.config.seeds:
                self._train(dataclasses.replace(config, seed=seed), progress)
        except TrialInterrupted:
            trial.set_user_attr(attributes.INTERRUPTED, True)
            trial.set_user_attr(attributes.FAILURE, "it was interrupted")
            raise
        except optuna.TrialPruned:
            raise
        except Exception as error:
            trial.set_user_attr(attributes.FAILURE, reason_of(error))
            raise
        finally:
            progress.note(time.monotonic() - started)
        return progress.value

    def _train(self, config: RunConfig, progress: _Progress) -> None:
        """Train and judge one model."""
        assert config.seed is not None, "seeds of a study are numbers"
        path = self.folder.trial_dir(progress.trial.number) / f"seed_{config.seed}"
        judge = METRICS[self.config.metric](
            callback_after_eval=AfterEvaluation(lambda: progress.evaluated(judge)),
            eval_freq=max(1, config.n_timesteps // self.config.n_evaluations // config.n_envs),
            n_eval_episodes=self.config.eval_episodes,
            seed=self.config.eval_seed,
        )
        callbacks: list[BaseCallback] = [judge]
        if self.config.minutes is not None:
            callbacks.append(TimeLimit(60 * self.config.minutes / len(self.config.seeds)))
        try:
            result = train(config, path, callbacks=callbacks, progress_bar=False)
        finally:
            # The replay buffer would fill the disk; a trial is not resumed but run again.
            shutil.rmtree(RunFolder(path).checkpoint_dir, ignore_errors=True)
        if result.interrupted:
            raise TrialInterrupted
        progress.steps += result.num_timesteps
        if progress.pruned:
            raise optuna.TrialPruned
        last = evaluate(path, self.config.eval_episodes, self.config.eval_seed)
        progress.trained(last.mean, judge)


class _Progress:
    """What a trial has reached so far."""

    def __init__(self, config: StudyConfig, trial: optuna.Trial):
        self.trial = trial
        self.steps = 0
        self.pruned = False
        self._config = config
        self._name = result_name(config.objective, config.metric)
        self._length = config.config.n_timesteps
        self._results: list[Mapping[str, float]] = []  # of each training that has ended

    @property
    def value(self) -> float:
        """The mean over the trainings that have ended."""
        return float(np.mean([found[self._name] for found in self._results]))

    def evaluated(self, judge: MetricEvalCallback) -> bool:
        """Report an evaluation during training; return whether the training goes on."""
        number = len(judge.evaluations_metrics)
        if number >= self._config.n_evaluations:
            return True  # the finished model is judged in its place
        found = results_of({}, judge)[self._name]
        values = [*(result[self._name] for result in self._results), found]
        interval = self._length // self._config.n_evaluations
        self._report(float(np.mean(values)), number * interval)
        return not self.pruned

    def trained(self, last: Mapping[str, float], judge: MetricEvalCallback) -> None:
        """Report what the model at the end of a training scored.

        Raises:
            RunError: If that is no number.
            optuna.TrialPruned: If there are seeds left, but the trial is not to go on.
        """
        found = results_of(last, judge)
        if not math.isfinite(found[self._name]):
            raise RunError(f"{self._name} is {found[self._name]}: expected a number.")
        self._results.append(found)
        self._report(self.value, 0)
        if self.pruned and len(self._results) < len(self._config.seeds):
            raise optuna.TrialPruned

    def _report(self, value: float, steps: int) -> None:
        """Report a value after some steps of the present training; see if that is the end."""
        self.trial.report(value, len(self._results) * self._length + steps)
        self.pruned = self.trial.should_prune()

    def note(self, seconds: float) -> None:
        """Note with the trial what it has reached."""
        noted = {attributes.STEPS: self.steps, attributes.SECONDS: round(seconds, 1)}
        values = [found[self._name] for found in self._results]
        results = {
            name: float(np.mean([found[name] for found in self._results]))
            for name in (self._results[0] if self._results else ())
        }
        for name, value in {**noted, attributes.VALUES: values, **results}.items():
            self.trial.set_user_attr(name, value)


def results_of(last: Mapping[str, float], judge: MetricEvalCallback) -> dict[str, float]:
    """Return final and best value of each metric of a training, by :func:`result_name`.

    Args:
        last: Metrics of the model at its end; empty for those of the last evaluation.
        judge: Has the evaluations before.
    """
    results = {}
    for metric in METRICS:
        values = [
            float(np.mean([episode.get(metric, math.nan) for episode in episodes]))
            for episodes in judge.evaluations_metrics
        ]
        values += [last[metric]] if metric in last else []
        results[result_name("final", metric)] = values[-1]
        results[result_name("best", metric)] = max(values)
    return results


def _without_evaluations(config: RunConfig) -> RunConfig:
    return dataclasses.replace(
        config, callback=tuple(plugin for plugin in config.callback if not _evaluates(plugin))
    )


def _evaluates(plugin: Plugin) -> bool:
    found = import_name(plugin.path)
    return isinstance(found, type) and issubclass(found, MetricEvalCallback)


def reason_of(error: BaseException) -> str:
    """Return in one line why a trial failed."""
    text = " ".join(str(error).split())
    reason = f"{type(error).__name__}: {text}" if text else type(error).__name__
    no_room = any(isinstance(one, MemoryError) for one in (error, error.__cause__))
    out_of_memory = no_room or "not enough memory" in text
    return f"out of memory: {reason}" if out_of_memory else reason
