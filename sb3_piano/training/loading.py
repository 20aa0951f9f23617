"""Saved models."""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.callbacks import Checkpoint
from sb3_piano.exceptions import RunError, one_line
from sb3_piano.planning import PianoPolicy
from sb3_piano.training.algorithms import PLANNERS
from sb3_piano.training.builders import build_model, build_planner
from sb3_piano.training.config import RunConfig
from sb3_piano.training.run_folder import RunFolder
from sb3_piano.training.weights import WEIGHTS_FILE, put_policy, read_weights


def load_model(config: RunConfig, path: Path, venv: VecEnv, **changes: Any) -> BaseAlgorithm:
    """Return a saved model on the given environments.

    Args:
        config: The run's settings.
        path: The model's zip file. Like all of SB3's it is unpickled: load only what you trust.
        venv: Environments with the spaces that the model was trained in.
        **changes: Attributes of the model to set before its networks and buffers are made.

    Raises:
        RunError: If the file is missing or damaged, or does not fit algorithm and environments.
    """
    device = config.algorithm_kwargs.get("device", "auto")
    try:
        return config.algorithm.load(path, env=venv, device=device, **changes)
    except Exception as error:  # unpickling fails in any way
        raise RunError(
            f"Model '{path}' cannot be loaded ({one_line(error)}): expected a model that "
            f"{config.algorithm.__name__} saved for {config.env_id!r}."
        ) from error


def load_player(config: RunConfig, path: Path, venv: VecEnv) -> BaseAlgorithm | PianoPolicy:
    """Return what plays in a run, without what only training needs.

    Args:
        config: The run's settings.
        path: As :func:`model_files` gives it.
        venv: The environments to play in.

    Raises:
        RunError: If a saved model cannot be loaded.
    """
    if config.algo in PLANNERS:
        return build_planner(config, venv)
    # A replay buffer would be as large as in training.
    off_policy = issubclass(config.algorithm, OffPolicyAlgorithm)
    if path.name == WEIGHTS_FILE:
        smallest = {"buffer_size": 2} if off_policy else {"n_steps": 2}
        return _model_of_weights(config, path, venv, smallest)
    return load_model(config, path, venv, **({"buffer_size": 1} if off_policy else {}))


def _model_of_weights(
    config: RunConfig, path: Path, venv: VecEnv, changes: dict[str, Any]
) -> BaseAlgorithm:
    """Return the model that the config describes, with weights that are no pickle."""
    tensors, num_timesteps = read_weights(path, config)
    arguments = {**config.algorithm_kwargs, **changes}
    with warnings.catch_warnings():  # that so few steps are no batch
        warnings.simplefilter("ignore", UserWarning)
        model = build_model(dataclasses.replace(config, algorithm_kwargs=arguments), venv)
    try:
        put_policy(tensors, model)
    except ValueError as error:
        raise RunError(
            f"Weights '{path}' do not fit ({error}): expected those of the model that the run's "
            "config describes."
        ) from error
    model.num_timesteps = num_timesteps
    return model


def model_files(
    run: RunFolder, config: RunConfig, best: str | None = None
) -> tuple[Path, Path | None]:
    """Return a model of a run and its statistics.

    Args:
        run: The run's folder.
        config: Its settings.
        best: The metric by which the model is the best; by default it is the newest one.

    Returns:
        The model's file, and that of ``VecNormalize`` if the run normalises: a zip file and a
        pickle, or of a shared run its weights. What plays without training is all in the run's
        config.

    Raises:
        RunError: If one of them is nowhere.
    """
    if best is None and config.algo in PLANNERS:
        return run.config_file, None
    weights = run.path / WEIGHTS_FILE
    if weights.is_file():  # then nothing is unpickled, whatever else the folder holds
        if best is not None:
            raise RunError(
                f"Run '{run.path}' was shared with one model, and has no best one by {best!r}: "
                "expected no metric."
            )
        return weights, None if config.normalize is False else weights
    return _newest_files(run, config) if best is None else _best_files(run, config, best)


def _best_files(run: RunFolder, config: RunConfig, metric: str) -> tuple[Path, Path | None]:
    folder = run.best_dir(metric)
    wanted = [folder / "best_model.zip"]
    if config.normalize is not False:
        wanted.append(folder / "vecnormalize.pkl")
    if not all(path.is_file() for path in wanted):
        known = run.best_metrics()
        have = f"it has one by {' and by '.join(known)}" if known else "it has none by any metric"
        raise RunError(
            f"Run '{run.path}' has no best model by {metric!r}, {have}: expected a training with "
            "sb3_piano.callbacks.F1Callback or OnsetF1Callback in its config, past its first "
            "evaluation."
        )
    return wanted[0], wanted[1] if len(wanted) > 1 else None


def _newest_files(run: RunFolder, config: RunConfig) -> tuple[Path, Path | None]:
    """Return the copies if they are there, or the checkpoint's."""
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
