"""Objective of a study: train with a trial's settings and evaluate the models."""

from __future__ import annotations

import dataclasses
import math
import platform
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import optuna
from optuna.trial import BaseTrial
from stable_baselines3.common.callbacks import BaseCallback, ConvertCallback

from sb3_piano.callbacks import MetricEvalCallback
from sb3_piano.callbacks.metric_eval import MOST_PIECES
from sb3_piano.exceptions import RunError
from sb3_piano.interrupts import stop_requested
from sb3_piano.jobs.job import reason_of
from sb3_piano.training import RunConfig, RunFolder, evaluate, train
from sb3_piano.training.configuration.entries import with_settings
from sb3_piano.training.configuration.yaml_files import entry_config
from sb3_piano.tuning import study as of_study
from sb3_piano.tuning.study import METRICS, StudyConfig, StudyFolder

Results = Mapping[str, float]
RESULTS = tuple(f"{model}_{metric}" for model in ("final", "best") for metric in METRICS)
"""Names of all results of a trial, such as ``best_onset_f1``: means over the seeds."""


@dataclass(frozen=True)
class Objective:
    """Train once from each seed of the study with a trial's settings, and evaluate the models.

    Each training is a run in ``trials/<number>/seed_<seed>`` of the study's folder, without its
    checkpoint. ``F1Callback`` or ``OnsetF1Callback`` evaluates it at equal distances, instead of
    the evaluations in the study's entry, and :func:`~sb3_piano.training.evaluate` at its end. After
    each evaluation, the mean of the present value and the finished trainings' values is reported at
    the sum of their environment steps, and the trial may be pruned.

    Use it with ``study.optimize(..., catch=(Exception,))``: an error is recorded with the trial and
    raised.
    """

    config: StudyConfig
    folder: StudyFolder

    def __call__(self, trial: BaseTrial) -> float:
        """Run a trial and return its value.

        Raises:
            optuna.TrialPruned: If the study's pruner ends it early.
            KeyboardInterrupt: If Ctrl-C or SIGTERM ended a training, or Ctrl-C an evaluation.
            Exception: Any error of a training or an evaluation; the reason is recorded.
        """
        path, results = self.folder.trial_dir(trial.number), list[Results]()
        trial.set_user_attr(of_study.HOST, platform.node())
        trial.set_user_attr(of_study.FOLDER, str(path))
        try:
            entry = with_settings(self.config.entry, self.config.space.suggest(trial))
            config = entry_config(self.config.algo, self.config.env_id, entry)
            others = tuple(each for each in config.callback if not each.is_a(MetricEvalCallback))
            for seed in self.config.seeds:
                run = dataclasses.replace(config, seed=seed, callback=others)
                results.append(self._train(run, path / f"seed_{seed}", trial, results))
                going_on = self._report(trial, results, 0)
                if not going_on and len(results) < len(self.config.seeds):
                    raise optuna.TrialPruned
        except optuna.TrialPruned:
            raise
        except Exception as error:
            trial.set_user_attr(of_study.FAILURE, reason_of(error))
            raise
        finally:
            trial.set_user_attr(of_study.VALUES, self._values(results))
            for name in RESULTS if results else ():
                trial.set_user_attr(name, fmean(found[name] for found in results))
        return fmean(self._values(results))

    def _values(self, results: Sequence[Results]) -> list[float]:
        return [found[f"{self.config.objective}_{self.config.metric}"] for found in results]

    def _report(self, trial: BaseTrial, results: Sequence[Results], steps: int) -> bool:
        """Report a mean after steps of an unfinished training; return whether to continue."""
        n_whole = len(results) - bool(steps)
        steps += n_whole * self.config.config.n_timesteps
        trial.report(fmean(self._values(results)), steps)
        return not trial.should_prune()

    def _train(
        self, config: RunConfig, path: Path, trial: BaseTrial, before: Sequence[Results]
    ) -> Results:
        """Train and evaluate one model; return its results."""
        study, going_on = self.config, True

        def evaluated(*_: object) -> bool:
            nonlocal going_on
            number = len(judge.evaluations_metrics)
            if number < study.n_evaluations:  # the finished model replaces the last evaluation
                results = [*before, _results_of({}, judge)]
                going_on = self._report(trial, results, number * study.interval)
            return going_on

        episodes, n_pieces = study.eval_episodes, max(len(config.pieces), 1)
        judge = METRICS[study.metric](
            callback_after_eval=ConvertCallback(evaluated),
            eval_freq=max(1, config.n_timesteps // study.n_evaluations // config.n_agents),
            n_eval_episodes=None if episodes == 1 else episodes * min(n_pieces, MOST_PIECES),
            seed=study.eval_seed,
        )
        end = time.monotonic() + 60 * (study.minutes or math.inf) / len(study.seeds)
        try:
            result = train(config, path, callbacks=[_Limit(end), judge], progress_bar=False)
        except _StoppedError:
            raise KeyboardInterrupt from None
        finally:
            # The replay buffer would fill the disk; a trial is not resumed but repeated.
            shutil.rmtree(RunFolder(path).checkpoint_dir, ignore_errors=True)
        done = trial.user_attrs.get(of_study.STEPS, 0) + result.num_timesteps
        trial.set_user_attr(of_study.STEPS, done)
        if not going_on:
            raise optuna.TrialPruned
        last = None if result.interrupted else evaluate(path, episodes, study.eval_seed)
        if last is None or last.interrupted:
            raise KeyboardInterrupt
        found = _results_of(last.mean, judge)
        (value,) = self._values([found])
        if not math.isfinite(value):
            raise RunError(f"{study.value_name} is {value}: expected a number.")
        return found


class _StoppedError(Exception):
    """Raised to end a training at a signal without the slow save: trials are not resumed."""


class _Limit(BaseCallback):
    """Callback that ends a training at a time limit, and at once on a signal."""

    def __init__(self, end: float) -> None:
        super().__init__()
        self._end = end

    def _on_rollout_start(self) -> None:
        if stop_requested():
            raise _StoppedError

    def _on_step(self) -> bool:
        self._on_rollout_start()
        return time.monotonic() < self._end


def _results_of(last: Results, judge: MetricEvalCallback) -> Results:
    """Return final and best value of each metric of a training, by the names of :data:`RESULTS`.

    ``last`` has the metrics of the final model; if empty, the last evaluation counts.
    """
    results, found = {}, [judge.means(number) for number in range(len(judge.evaluated_at))]
    for metric in METRICS:
        values = [means.get(metric, math.nan) for means in (*found, *filter(None, [last]))]
        results[f"final_{metric}"] = values[-1]
        results[f"best_{metric}"] = max(values)
    return results
