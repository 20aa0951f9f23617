"""Objective of a study: how well models play that were trained with a trial's settings."""

from __future__ import annotations

import dataclasses
import math
import platform
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import optuna
from optuna.trial import BaseTrial
from stable_baselines3.common.callbacks import BaseCallback, ConvertCallback

from sb3_piano.callbacks import MetricEvalCallback
from sb3_piano.callbacks.metric_eval import MOST_PIECES
from sb3_piano.exceptions import RunError, no_memory
from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.training import RunConfig, RunFolder, evaluate, train
from sb3_piano.training.configuration.yaml_files import entry_config
from sb3_piano.tuning import trials
from sb3_piano.tuning.space import with_settings
from sb3_piano.tuning.study import METRICS, OBJECTIVES, StudyConfig, StudyFolder

RESULTS = tuple(f"{objective}_{metric}" for objective in OBJECTIVES for metric in METRICS)
"""Names of all results of a trial, such as ``best_onset_f1``: means over the seeds."""


@dataclass(frozen=True)
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
    """

    config: StudyConfig
    folder: StudyFolder

    def __call__(self, trial: BaseTrial) -> float:
        """Run a trial and return its value.

        Raises:
            optuna.TrialPruned: If the study's pruner ends it early.
            KeyboardInterrupt: If Ctrl-C or SIGTERM ended a training, or Ctrl-C an evaluation.
            Exception: Whatever a training or an evaluation raises, with the reason noted.
        """
        started, progress = time.monotonic(), _Progress(self.config, trial)
        path = self.folder.trial_dir(trial.number)
        trial.set_user_attr(trials.HOST, platform.node())
        trial.set_user_attr(trials.FOLDER, str(path))
        try:
            entry = with_settings(self.config.entry, self.config.space.suggest(trial))
            config = entry_config(self.config.algo, self.config.env_id, entry)
            others = tuple(each for each in config.callback if not each.is_a(MetricEvalCallback))
            for seed in self.config.seeds:
                run = dataclasses.replace(config, seed=seed, callback=others)
                self._train(run, path / f"seed_{seed}", progress)
        except optuna.TrialPruned:
            raise
        except KeyboardInterrupt:
            trial.set_user_attr(trials.INTERRUPTED, True)
            raise
        except Exception as error:
            trial.set_user_attr(trials.FAILURE, reason_of(error))
            raise
        finally:
            trial.set_user_attr(trials.SECONDS, round(time.monotonic() - started, 1))
            progress.note()
        return float(np.mean(progress.values))

    def _train(self, config: RunConfig, path: Path, progress: _Progress) -> None:
        """Train and judge one model."""
        episodes, n_pieces = self.config.eval_episodes, max(len(config.pieces), 1)
        judge = METRICS[self.config.metric](
            callback_after_eval=ConvertCallback(lambda *_: progress.evaluated(judge)),
            eval_freq=max(1, config.n_timesteps // self.config.n_evaluations // config.n_agents),
            n_eval_episodes=None if episodes == 1 else episodes * min(n_pieces, MOST_PIECES),
            seed=self.config.eval_seed,
        )
        minutes = math.inf if self.config.minutes is None else self.config.minutes
        try:
            with stop_on_signal() as request:
                limit = _Limit(60 * minutes / len(self.config.seeds), request)
                result = train(config, path, callbacks=[limit, judge], progress_bar=False)
        except _StoppedError:
            raise KeyboardInterrupt from None
        finally:
            # The replay buffer would fill the disk; a trial is not resumed but run again.
            shutil.rmtree(RunFolder(path).checkpoint_dir, ignore_errors=True)
        if result.interrupted:
            raise KeyboardInterrupt
        progress.steps += result.num_timesteps
        if progress.pruned:
            raise optuna.TrialPruned
        last = evaluate(path, self.config.eval_episodes, self.config.eval_seed)
        if last.interrupted:
            raise KeyboardInterrupt
        progress.trained(last.mean, judge)


@dataclass
class _Progress:
    """Progress of a trial."""

    config: StudyConfig
    trial: BaseTrial
    steps: int = 0
    pruned: bool = False
    results: list[Mapping[str, float]] = field(default_factory=list)
    """Of each training that has ended."""

    @property
    def _name(self) -> str:
        return f"{self.config.objective}_{self.config.metric}"

    @property
    def values(self) -> list[float]:
        """The value of each training that has ended."""
        return [found[self._name] for found in self.results]

    def evaluated(self, judge: MetricEvalCallback) -> bool:
        """Report an evaluation during training; return whether the training goes on."""
        number = len(judge.evaluations_metrics)
        if number >= self.config.n_evaluations:
            return True  # the finished model is judged in its place
        found = _results_of({}, judge)[self._name]
        self._report([*self.values, found], number * self.config.interval)
        return not self.pruned

    def trained(self, last: Mapping[str, float], judge: MetricEvalCallback) -> None:
        """Report what the model at the end of a training scored.

        Raises:
            RunError: If that is no number.
            optuna.TrialPruned: If there are seeds left, but the trial is not to go on.
        """
        found = _results_of(last, judge)
        if not math.isfinite(found[self._name]):
            raise RunError(f"{self._name} is {found[self._name]}: expected a number.")
        self.results.append(found)
        self._report(self.values, 0)
        if self.pruned and len(self.results) < len(self.config.seeds):
            raise optuna.TrialPruned

    def _report(self, values: list[float], steps: int) -> None:
        """Report a mean after some steps of the present training; see if that is the end."""
        before = len(self.results) * self.config.config.n_timesteps
        self.trial.report(float(np.mean(values)), before + steps)
        self.pruned = self.trial.should_prune()

    def note(self) -> None:
        """Note with the trial what it has reached."""
        self.trial.set_user_attr(trials.STEPS, self.steps)
        self.trial.set_user_attr(trials.VALUES, self.values)
        for name in RESULTS if self.results else ():
            mean = float(np.mean([found[name] for found in self.results]))
            self.trial.set_user_attr(name, mean)


class _StoppedError(Exception):
    """Ctrl-C or SIGTERM came: a training that is not resumed need not save anything."""


class _Limit(BaseCallback):
    """Ends the training after some seconds, and at once if that is requested."""

    def __init__(self, seconds: float, request: StopRequest) -> None:
        super().__init__()
        self._seconds = seconds
        self._request = request
        self._end = math.inf

    def _on_training_start(self) -> None:
        self._end = time.monotonic() + self._seconds

    def _on_rollout_start(self) -> None:
        if self._request.made:
            raise _StoppedError

    def _on_step(self) -> bool:
        self._on_rollout_start()
        return time.monotonic() < self._end


def _results_of(last: Mapping[str, float], judge: MetricEvalCallback) -> dict[str, float]:
    """Return final and best value of each metric of a training, by the names of :data:`RESULTS`.

    ``last`` has the metrics of the model at its end; empty stands for those of the last evaluation.
    """
    results = {}
    for metric in METRICS:
        values = [
            float(np.mean([episode.get(metric, math.nan) for episode in episodes]))
            for episodes in judge.evaluations_metrics
        ]
        values += [last[metric]] if metric in last else []
        results[f"final_{metric}"] = values[-1]
        results[f"best_{metric}"] = max(values)
    return results


def reason_of(error: BaseException) -> str:
    """Return in one line why a trial failed."""
    text = " ".join(str(error).split())
    reason = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return f"out of memory: {reason}" if no_memory(error) else reason
