"""Evaluation: what a trained model plays, beside playing nothing."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from sb3_piano.callbacks import Checkpoint
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.files import write_json
from sb3_piano.music import Score, write_midi
from sb3_piano.training.builders import build_vec_env
from sb3_piano.training.config import RunConfig
from sb3_piano.training.loading import load_model
from sb3_piano.training.recorder import EpisodeRecorder, Recording
from sb3_piano.training.run_folder import RunFolder


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What :func:`evaluate` found.

    The names of metrics are ``return``, ``length`` (steps) and, for piano environments, those of
    ``sb3_piano.metrics.EPISODE_METRICS`` and ``sb3_piano.envs.RETURN_KEYS``.
    """

    num_timesteps: int
    """Environment steps that the model was trained for."""
    episodes: tuple[Mapping[str, float], ...]
    """Metrics of each episode."""
    mean: Mapping[str, float]
    """Mean of each metric over the episodes."""
    std: Mapping[str, float]
    """Standard deviation of each metric over the episodes (of the population; 0 for one)."""
    baseline: Mapping[str, float] | None
    """Metrics of an episode in which the hands rest; ``None`` if the environment is no piano."""
    performances: tuple[Path | None, ...]
    """The MIDI file of each episode; ``None`` if no key was pressed in it."""
    metrics_file: Path
    """Where all these numbers are."""


def evaluate(
    folder: str | os.PathLike[str],
    episodes: int = 1,
    seed: int = 0,
    *,
    physics: str | None = None,
) -> Evaluation:
    """Let a run's saved model play, without exploring, and write down how well it did.

    The environment has the run's wrappers and normalisation; returns and metrics are those of the
    bare environment inside. Writes ``evaluation/metrics.json`` and, from 1 on,
    ``evaluation/performance_<i>.mid`` into the run's folder, in place of those that were there.

    Args:
        folder: The run's folder.
        episodes: How many episodes to play, at least 1.
        seed: Seeds the environment; the resting hands get the same as the model.
        physics: Name of the physics profile to play on; by default the run's own.

    Raises:
        ConfigError: If ``episodes`` or ``seed`` is out of range, or the run's config is damaged.
        RunError: If there is no run, or it has no model that can be loaded.
    """
    for name, value, least in (("episodes", episodes, 1), ("seed", seed, 0)):
        if value < least:
            raise ConfigError(f"{name} is {value}: expected {least} or more.")
    run = RunFolder.open(folder)
    config = run.read_config()
    env_kwargs = {**config.env_kwargs, **({} if physics is None else {"physics": physics})}
    config = dataclasses.replace(
        config, env_kwargs=env_kwargs, n_envs=1, vec_env="dummy", seed=seed, monitor_kwargs={}
    )
    model_file, statistics = _saved_files(run, config)
    recorders: list[EpisodeRecorder] = []

    def record(env: Any) -> EpisodeRecorder:
        recorders.append(EpisodeRecorder(env))
        return recorders[-1]

    venv = build_vec_env(config, statistics, innermost=record)
    try:
        if isinstance(venv, VecNormalize):
            venv.training = False
        model = _load(config, model_file, venv)
        played = _play(model, venv, recorders[0], episodes, seed)
        baseline = _rest(model, venv, recorders[0], seed)
    finally:
        venv.close()
    return _write(run, model.num_timesteps, played, baseline, seed, env_kwargs)


def _saved_files(run: RunFolder, config: RunConfig) -> tuple[Path, Path | None]:
    """Return the newest model and its statistics: the copies if there, or the checkpoint's.

    Raises:
        RunError: If one of them is nowhere.
    """
    statistics = run.model_file.with_name("vecnormalize.pkl")
    wanted = [run.model_file] if config.normalize is False else [run.model_file, statistics]
    if all(path.is_file() for path in wanted):
        return run.model_file, statistics if statistics in wanted else None
    saved = Checkpoint.read(run.checkpoint_dir)
    if saved is None:
        raise RunError(
            f"Run '{run.path}' has no model: expected {' and '.join(p.name for p in wanted)}, "
            "written with the first checkpoint. To go on with it: sb3-piano train --resume "
            f"{run.path}"
        )
    normalization = saved.vec_normalize
    return (
        run.checkpoint_dir / saved.model,
        None if normalization is None else run.checkpoint_dir / normalization,
    )


def _load(config: RunConfig, path: Path, venv: VecEnv) -> BaseAlgorithm:
    # The replay buffer is not needed, and would be as large as in training.
    off_policy = issubclass(config.algorithm, OffPolicyAlgorithm)
    return load_model(config, path, venv, **({"buffer_size": 1} if off_policy else {}))


def _play(
    model: BaseAlgorithm, venv: VecEnv, recorder: EpisodeRecorder, episodes: int, seed: int
) -> list[Recording]:
    """Play until so many more episodes are recorded, and return them."""
    venv.seed(seed)
    observation: Any = venv.reset()
    recorder.finished.clear()
    state, starts = None, np.ones(1, dtype=bool)
    while len(recorder.finished) < episodes:
        action, state = model.predict(observation, state, starts, deterministic=True)
        observation, _, starts, _ = venv.step(action)
    return list(recorder.finished)


def _rest(
    model: BaseAlgorithm, venv: VecEnv, recorder: EpisodeRecorder, seed: int
) -> Recording | None:
    """Return an episode in which the hands rest, in the same environment and from the same seed."""
    if not recorder.can_rest:
        return None
    recorder.resting = True
    return _play(model, venv, recorder, 1, seed)[0]


def _write(
    run: RunFolder,
    num_timesteps: int,
    played: Sequence[Recording],
    baseline: Recording | None,
    seed: int,
    env_kwargs: Mapping[str, Any],
) -> Evaluation:
    episodes = tuple(recording.metrics for recording in played)
    values = {name: [metrics[name] for metrics in episodes] for name in episodes[0]}
    evaluation = Evaluation(
        num_timesteps=num_timesteps,
        episodes=episodes,
        mean={name: float(np.mean(column)) for name, column in values.items()},
        std={name: float(np.std(column)) for name, column in values.items()},
        baseline=None if baseline is None else baseline.metrics,
        performances=_write_performances(run, [recording.performance for recording in played]),
        metrics_file=run.evaluation_dir / "metrics.json",
    )
    content = {
        **vars(evaluation),
        "seed": seed,
        "env_kwargs": dict(env_kwargs),
        "performances": [None if path is None else path.name for path in evaluation.performances],
    }
    del content["metrics_file"]
    write_json(evaluation.metrics_file, content)
    return evaluation


def _write_performances(
    run: RunFolder, performances: Sequence[Score | None]
) -> tuple[Path | None, ...]:
    try:
        run.evaluation_dir.mkdir(exist_ok=True)
        for stale in run.evaluation_dir.glob("performance_*.mid"):
            stale.unlink()
    except OSError as error:
        raise RunError(
            f"'{run.evaluation_dir}' cannot be written: {error.strerror}. Expected a folder."
        ) from error
    paths: list[Path | None] = []
    for number, score in enumerate(performances, start=1):
        path = run.evaluation_dir / f"performance_{number}.mid"
        if score is not None:
            write_midi(score, path)
        paths.append(None if score is None else path)
    return tuple(paths)
