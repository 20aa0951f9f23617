"""Evaluation during training by a music metric in place of the return."""

from __future__ import annotations

import contextlib
import logging
import sys
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.logger import HumanOutputFormat
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.array_files import read_arrays
from sb3_piano.callbacks.checkpoint import write_normalization
from sb3_piano.callbacks.condition import Condition
from sb3_piano.callbacks.episode_metrics import NOT_PRINTED, finite_number
from sb3_piano.callbacks.own_env import OwnEnvCallback, RunContext, env_name, preserve_random_state
from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.files import read_json, write_atomically, write_json
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.players.policy import agents_of
from sb3_piano.settings import Count, checked
from sb3_piano.wrappers import RandomPiece

_log = logging.getLogger(__name__)

_NOTE = "best_model.json"
MOST_PIECES = 12
"""Largest number of a run's pieces in an evaluation, by default."""


@dataclass(frozen=True, kw_only=True)
class BestModel:
    """Content of ``best_model.json``, about the ``best_model.zip`` beside it."""

    metric: str
    """Metric by which it is the best."""
    value: float
    """Mean of the metric over the episodes of the evaluation."""
    num_timesteps: int
    """Environment steps of the model's training."""

    def save(self, folder: Path, model: BaseAlgorithm) -> None:
        """Write this model, with the statistics of ``VecNormalize`` if it has any.

        The note comes last: after a crash in between it tells of the model before, never of one
        that is not there.
        """
        write_atomically(folder / "best_model.zip", model.save)
        write_normalization(model, folder / "vecnormalize.pkl")
        write_json(folder / _NOTE, vars(self))

    @classmethod
    def read(cls, folder: Path) -> BestModel | None:
        """Return the record of a folder's best model, or ``None`` if it has none.

        Raises:
            RunError: If the file is damaged.
        """
        expected = "expected the file that stands beside a best model. Without it, the next "
        return read_json(folder / _NOTE, cls, f"{expected}evaluation counts as the best.")


_BASELINE = "noop_f1"


class MetricEvalCallback(OwnEnvCallback, EvalCallback):
    """SB3's ``EvalCallback`` with a metric of the final ``info`` in place of the return.

    Every ``eval_freq`` calls it plays some episodes in an environment of its own and logs, in one
    line of the log, what ``EvalCallback`` logs and the mean of each metric of
    :data:`~sb3_piano.metrics.EPISODE_METRICS` as ``eval/<name>``; among them is ``eval/noop_f1``,
    the F1 of playing nothing. The best model is the one with the highest :attr:`metric`, and
    ``best_mean_reward`` and ``last_mean_reward`` are that metric's: SB3's
    ``StopTrainingOnNoModelImprovement`` and ``StopTrainingOnRewardThreshold`` work with it as they
    are. A subclass names the metric::

        class RecallCallback(MetricEvalCallback):
            metric = "recall"

    A call is one step of all environments together: with ``n_envs`` environments, ``eval_freq``
    calls are ``eval_freq * n_envs`` environment steps.

    Environment and random generators are the callback's own: training with and without it gives the
    same model.

    Args:
        eval_env: The environment to play in; the caller closes it. By default it is made
            from the run's config in a training by ``sb3-piano train``, and otherwise a copy of the
            first training environment, which must then be in this process (``DummyVecEnv``,
            ``ThreadVecEnv``). It has the wrappers and the normalisation of the training.
        callback_on_new_best: As of ``EvalCallback``, like all arguments not listed here.
        n_eval_episodes: Episodes of an evaluation, at least 1. By default one, which is enough for
            a piece that always starts alike; of several pieces (``pieces``, or a
            :class:`~sb3_piano.wrappers.RandomPiece`) one of each, of the first 12 at most. Pieces
            are played in turn, unless ``eval_env`` is given. Where several agents play an episode
            together, as in :class:`~sb3_piano.vec_env.HandsAsAgents`, it counts once.
        eval_freq: Calls between two evaluations; 0 for none at all.
        log_path: Folder of ``evaluations.npz``, with which a training that is resumed goes on. It
            also gets each metric, (evaluations, episodes); with agents that play an episode
            together SB3's ``results`` have a column for each of them. By default it is not written.
        best_model_save_path: Folder of ``best_model.zip``, ``best_model.json`` with what it scored
            and, if the training normalises, ``vecnormalize.pkl``. A training that goes on
            (``num_timesteps`` above 0) replaces what is there only by something better. By default
            ``best_<metric>`` in the folder of a run by ``sb3-piano train``, and otherwise nowhere.
        seed: Seeds the environment and the random generators of each evaluation, so that
            evaluations are comparable; ``None`` lets them go on from the last one.
        stop_threshold: End the training when the metric is this high; by default it never does.
        stop_patience: In how many evaluations in a row it has to be, at least 1.
        evaluate_start: Whether to evaluate once before a training begins (not one that goes on): a
            model that plays already is then the best one until it has become better.

    Raises:
        ConfigError: If a number is out of range, or ``eval_env`` is one of Gymnasium's own; when
            training starts, if the training's is, or cannot be copied; at an evaluation, if
            ``info`` lacks the metric, or a wrapper around the ``Monitor`` ends an episode.
        RunError: When a training goes on, if ``best_model.json`` is damaged.
    """

    metric: ClassVar[str]
    """Key of ``info`` that ranks models; more is better."""

    def __init__(
        self,
        eval_env: gym.Env[Any, Any] | VecEnv | None = None,
        callback_on_new_best: BaseCallback | None = None,
        callback_after_eval: BaseCallback | None = None,
        n_eval_episodes: int | None = None,
        eval_freq: int = 10_000,
        log_path: str | None = None,
        best_model_save_path: str | None = None,
        deterministic: bool = True,
        render: bool = False,
        verbose: int = 0,
        warn: bool = True,
        *,
        seed: int | None = 0,
        stop_threshold: float | None = None,
        stop_patience: int = 1,
        evaluate_start: bool = False,
    ) -> None:
        if not hasattr(self, "metric"):
            raise ConfigError(
                f"{type(self).__name__} has no metric: expected F1Callback, OnsetF1Callback or a "
                "subclass with metric = '...'."
            )
        self._n_episodes = checked("n_eval_episodes", n_eval_episodes, Count | None)
        super().__init__(
            _UnbuiltEnv() if eval_env is None else eval_env,
            callback_on_new_best,
            callback_after_eval,
            self._n_episodes or 1,
            eval_freq,
            log_path,
            best_model_save_path,
            deterministic,
            render,
            verbose,
            warn,
        )
        self.seed = seed
        patience = checked("stop_patience", stop_patience, Count)
        self.until: Condition | None = None
        """When the training ends."""
        if stop_threshold is not None:
            thresholds = {self.metric: stop_threshold}
            self.until = Condition(thresholds=thresholds, patience=patience)
        self.evaluate_start = evaluate_start
        self.evaluations_metrics: list[list[Mapping[str, float]]] = []
        """The metrics of each episode of each evaluation."""
        self.evaluated_at: list[int] = []
        """Environment steps that were done at each evaluation."""
        self._makes_env = eval_env is None
        if not self._makes_env:
            self._refuse_other_tasks()
        self._goes_on = True

    def use_run(self, run: RunContext) -> None:
        """Set the environment, and the folder of the best model, from a run."""
        super().use_run(run)
        if self.best_model_save_path is None:
            self.best_model_save_path = str(run.folder / f"best_{self.metric}")

    def _init_callback(self) -> None:
        with warnings.catch_warnings():
            if self._makes_env:
                self.eval_env = self._make_own_env()
                # Training in processes or threads, evaluating without them is as it should be.
                warnings.filterwarnings("ignore", "Training and eval env are not of the same type")
            super()._init_callback()
        self._refuse_other_tasks()
        # SB3 counts the episodes of each agent.
        n_pieces = self._play_in_turn() if self._makes_env else 1
        self.n_eval_episodes = (self._n_episodes or min(n_pieces, MOST_PIECES)) * self._agents
        if self.model.num_timesteps > 0:
            self._read_evaluations_file()
        if self.best_model_save_path is not None and self.model.num_timesteps > 0:
            saved = BestModel.read(Path(self.best_model_save_path))
            if saved is not None and saved.metric == self.metric:
                self.best_mean_reward = max(self.best_mean_reward, saved.value)

    def _refuse_other_tasks(self) -> None:
        """Refuse Gymnasium's own environments before the training, not at its first evaluation.

        A wrapper from elsewhere may add the metric.
        """
        spec = self.eval_env.unwrapped.get_attr("spec")[0]
        parts = [] if spec is None else [spec, *spec.additional_wrappers]
        known = [
            str(part.entry_point).startswith(("gymnasium.", "stable_baselines3.")) for part in parts
        ]
        if known and all(known) and self.metric in EPISODE_METRICS:
            raise ConfigError(
                f"{type(self).__name__} cannot evaluate {spec.id}, whose episodes have no "
                f"{self.metric!r}: expected a piano environment."
            )

    def _play_in_turn(self) -> int:
        """Make the own environment play its pieces in turn; return their number."""
        venv = self.eval_env.unwrapped
        if not venv.env_is_wrapped(RandomPiece)[0]:
            return 1
        venv.env_method("play_in_turn")
        return len(venv.get_attr("piece_names")[0])

    @property
    def _agents(self) -> int:
        """Number of agents, with neighbouring indices, of each environment."""
        return agents_of(self.eval_env)

    def _on_training_start(self) -> None:
        super()._on_training_start()
        self._goes_on = True
        if self.evaluate_start and self.num_timesteps == 0:
            self._goes_on = self._on_step()  # which SB3 asks for only after a step

    def _on_step(self) -> bool:
        if not self._goes_on:
            return False
        if self.eval_freq <= 0 or self.n_calls % self.eval_freq != 0:
            return True
        self.evaluations_metrics.append([])
        self.evaluated_at.append(self.num_timesteps)
        with preserve_random_state(self.model, self.seed), self._preserve_judgement():
            if self.seed is not None:
                self.eval_env.seed(self.seed)
            super()._on_step()
        self._complete_evaluations_file()
        return self._judge()

    @contextlib.contextmanager
    def _preserve_judgement(self) -> Iterator[None]:
        """Let ``EvalCallback`` evaluate and log, but not compare returns or call children."""
        callback, self.callback = self.callback, None
        best, self.best_mean_reward = self.best_mean_reward, np.inf
        try:
            yield
        finally:
            self.callback, self.best_mean_reward = callback, best

    def _log_success_callback(self, locals_: dict[str, Any], globals_: dict[str, Any]) -> None:
        super()._log_success_callback(locals_, globals_)
        info = locals_["info"]
        if not locals_["done"]:
            return
        # Under a Monitor evaluate_policy counts only the ends that Monitor saw.
        if locals_["is_monitor_wrapped"] and "episode" not in info:
            raise ConfigError(
                f"An episode of {env_name(self.eval_env)} was ended by a wrapper around its "
                f"Monitor, where {type(self).__name__} has no metrics and SB3 would not count it: "
                "expected the environment to end it, as with sb3_piano.wrappers.Excerpt."
            )
        if locals_["i"] % self._agents == 0:
            self._add_episode(info)

    def _add_episode(self, info: Mapping[str, Any]) -> None:
        if self.metric not in info:
            raise ConfigError(
                f"{type(self).__name__} looks for {self.metric!r}, which the info of "
                f"{env_name(self.eval_env)} lacks at the end of an episode."
                f"{near_names(self.metric, info)} Expected a piano environment, and no wrapper "
                "around it that ends an episode with an info of its own."
            )
        names = dict.fromkeys((*EPISODE_METRICS, self.metric))
        numbers = {name: finite_number(info.get(name)) for name in names}
        metrics = {name: number for name, number in numbers.items() if number is not None}
        self.evaluations_metrics[-1].append(metrics)
        for name, number in metrics.items():
            hidden = name in NOT_PRINTED and name != self.metric
            self.logger.record_mean(f"eval/{name}", number, exclude="stdout" if hidden else None)

    def means(self, number: int) -> dict[str, float]:
        """Return the mean of each metric that all episodes of an evaluation have."""
        episodes = self.evaluations_metrics[number]
        names = set(episodes[0]).intersection(*episodes) if episodes else set()
        return {name: float(np.mean([found[name] for found in episodes])) for name in names}

    def _read_evaluations_file(self) -> None:
        """Continue the evaluations file of an interrupted training; SB3 would overwrite it."""
        if self.log_path is None or not Path(f"{self.log_path}.npz").is_file():
            return
        try:
            content = read_arrays(f"{self.log_path}.npz")
            done = content["timesteps"] <= self.model.num_timesteps
            rows = {name: array[done].tolist() for name, array in content.items()}
        except (OSError, ValueError, KeyError, IndexError) as error:
            _log.warning("'%s.npz' cannot be read, and begins anew: %s", self.log_path, error)
            return
        if any(len(lengths) != self.n_eval_episodes for lengths in rows["ep_lengths"]):
            return  # they do not fit into one array
        self.evaluations_timesteps = rows.pop("timesteps")
        self.evaluated_at = list(self.evaluations_timesteps)
        self.evaluations_results = rows.pop("results")
        self.evaluations_length = rows.pop("ep_lengths")
        self.evaluations_successes = rows.pop("successes", [])
        episodes = range(self.n_eval_episodes // self._agents)
        self.evaluations_metrics = [
            [{name: values[row][episode] for name, values in rows.items()} for episode in episodes]
            for row in range(len(self.evaluations_timesteps))
        ]

    def _complete_evaluations_file(self) -> None:
        if self.log_path is None:
            return
        arrays: dict[str, Any] = read_arrays(f"{self.log_path}.npz")
        names = {name for episodes in self.evaluations_metrics for e in episodes for name in e}
        for name in names:
            arrays[name] = np.array(
                [[e.get(name, np.nan) for e in episodes] for episodes in self.evaluations_metrics]
            )
        np.savez(self.log_path, **arrays)

    def _judge(self) -> bool:
        """Compare an evaluation with the best; return whether the training continues."""
        means = self.means(-1)
        value = means.get(self.metric, np.nan)
        self.last_mean_reward = value
        goes_on = True
        if value > self.best_mean_reward:
            self.best_mean_reward = value
            if self.best_model_save_path is not None:
                steps = self.num_timesteps
                best = BestModel(metric=self.metric, value=value, num_timesteps=steps)
                best.save(Path(self.best_model_save_path), self.model)
            if self.callback_on_new_best is not None:
                goes_on = self.callback_on_new_best.on_step()
        baseline = means.get(_BASELINE)
        beside = "" if baseline is None else f", F1 of playing nothing {baseline:.4f}"
        self._tell(
            f"{self.metric} {value:.4f} after {self.num_timesteps} steps (best "
            f"{self.best_mean_reward:.4f}{beside})"
        )
        return goes_on and self._on_event() and not self._is_high_enough()

    def _is_high_enough(self) -> bool:
        """Return whether the condition to end the training is met."""
        if self.until is None:
            return False
        first = max(len(self.evaluations_metrics) - self.until.patience, 0)
        evaluations = [self.means(n) for n in range(first, len(self.evaluations_metrics))]
        if not self.until.is_met(evaluations):
            return False
        self._tell(
            f"{self.metric} was {self.until.thresholds[self.metric]} or more in "
            f"{self.until.patience} evaluations in a row: the training ends."
        )
        return True

    def _tell(self, text: str) -> None:
        if self.verbose >= 1:
            HumanOutputFormat(sys.stdout).write_sequence([text])


class _UnbuiltEnv(gym.Env[Any, Any]):
    """Placeholder of an environment that is made when the training starts."""

    observation_space = action_space = gym.spaces.Discrete(1)


class F1Callback(MetricEvalCallback):
    """Evaluate and keep the best model by F1 over keys and control steps."""

    metric = "f1"


class OnsetF1Callback(MetricEvalCallback):
    """Evaluate and keep the best model by onset F1: is each note struck in time."""

    metric = "onset_f1"
