"""Training: from a config to a model in a folder, and on from where it stopped."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import logging
import os
import shlex
import shutil
from collections.abc import Iterator, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.callbacks import Checkpoint, restore_replay_buffer
from sb3_piano.callbacks.checkpoint import DEFAULT_EVERY
from sb3_piano.callbacks.replay_segments import end_last_episode
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.files import disk_refusal
from sb3_piano.settings import Count, checked
from sb3_piano.threads import torch_threads
from sb3_piano.training.algorithms import algorithm_class
from sb3_piano.training.builders import build_callbacks, build_model, build_vec_env
from sb3_piano.training.config import RunConfig
from sb3_piano.training.env_ids import registered_id
from sb3_piano.training.loading import load_model
from sb3_piano.training.run_folder import RunFolder
from sb3_piano.training.session import Session, TrainResult
from sb3_piano.training.weights import WEIGHTS_FILE

_log = logging.getLogger(__name__)


def train(
    config: RunConfig,
    folder: str | os.PathLike[str] | None = None,
    *,
    runs_dir: str | os.PathLike[str] = "runs",
    callbacks: Sequence[BaseCallback] = (),
    progress_bar: bool = True,
    checkpoint_every: int = DEFAULT_EVERY,
) -> TrainResult:
    """Train a new model.

    The folder is made once environment and model are known to work. Ctrl-C or SIGTERM ends the
    training with a checkpoint; after any other end :func:`resume` goes on from the last one.

    Args:
        config: What to train; without a seed, one is drawn and noted down.
        folder: The run's folder, new or empty; by default the next free one in ``runs_dir``.
        runs_dir: Where runs are kept.
        callbacks: Callbacks beside the config's. The run's folder does not know them, so that
            :func:`resume` goes on without.
        progress_bar: Whether to show progress on the terminal.
        checkpoint_every: Environment steps between two checkpoints.

    Raises:
        ConfigError: If environment, algorithm or callbacks refuse their settings.
        RunError: If the folder cannot be used.
    """
    checkpoint_every = checked("checkpoint_every", checkpoint_every, Count)
    if config.seed is None:
        config = dataclasses.replace(config, seed=int(np.random.default_rng().integers(2**31)))
    with torch_threads(config.num_threads), _closing(build_vec_env(config)) as venv:
        model, every_callback = build_model(config, venv), [*build_callbacks(config), *callbacks]
        run = RunFolder.create(config, folder, runs_dir)
        with _owned(run):
            return Session(
                config=config,
                folder=run,
                model=model,
                callbacks=every_callback,
                checkpoint_every=checkpoint_every,
                progress_bar=progress_bar,
            ).run()


def resume(
    folder: str | os.PathLike[str],
    steps: int | None = None,
    *,
    algo: str | None = None,
    env_id: str | None = None,
    progress_bar: bool = True,
    checkpoint_every: int = DEFAULT_EVERY,
) -> TrainResult:
    """Go on with a run from its last checkpoint, with its model, replay buffer and step count.

    A new episode begins, and random numbers are drawn from a seed made of the run's seed and the
    step count: two resumptions of one checkpoint are alike, but not like a run that never stopped.
    What goes by ``PianoEnv.total_steps``, as schedules of wrappers do, goes on where it was.

    A run that stopped before its first checkpoint starts over; one that has done its steps returns
    at once, see ``had_finished`` of the result.

    Args:
        folder: The run's folder.
        steps: The new total of environment steps; by default the run's.
        algo: The algorithm that the run is expected to have, if any.
        env_id: The environment that the run is expected to have, if any.
        progress_bar: Whether to show progress on the terminal.
        checkpoint_every: Environment steps between two checkpoints.

    Raises:
        ConfigError: If the run's config is damaged, or its environment cannot be made.
        RunError: If there is no run, it is another than expected, or its checkpoint is damaged.
    """
    checkpoint_every = checked("checkpoint_every", checkpoint_every, Count)
    run = RunFolder.open(folder)
    if (run.path / WEIGHTS_FILE).is_file():
        raise RunError(
            f"Run '{run.path}' was shared to be played, without what training needs to go on: "
            "expected the run that it was made of."
        )
    with _owned(run):
        config = run.read_config()
        algorithm_class(config.algo)  # what is not trained is told before anything is done
        _check_expected(run, config, algo, env_id)
        if steps is not None:
            config = dataclasses.replace(config, n_timesteps=steps)
        return _resumed(run, config, progress_bar, checkpoint_every)


def _resumed(
    run: RunFolder, config: RunConfig, progress_bar: bool, checkpoint_every: int
) -> TrainResult:
    """Go on with a run in a folder that this process owns."""
    saved = Checkpoint.read(run.checkpoint_dir)
    _check_labels(run, config, saved)
    done = 0 if saved is None else saved.num_timesteps
    if done >= config.n_timesteps:
        return TrainResult(
            folder=run, started_at=done, num_timesteps=done, n_timesteps=config.n_timesteps
        )
    statistics = None
    if saved is not None and saved.vec_normalize is not None:
        statistics = run.checkpoint_dir / saved.vec_normalize
    played_on = functools.partial(_played_on, steps=done // config.n_envs)
    with (
        torch_threads(config.num_threads),
        _closing(build_vec_env(config, statistics, innermost=played_on)) as venv,
    ):
        model = _fresh(run, config, venv) if saved is None else _restored(run, config, saved, venv)
        callbacks = build_callbacks(config)
        run.write_config(config)
        return Session(
            config=config,
            folder=run,
            model=model,
            callbacks=callbacks,
            resumed=saved,
            checkpoint_every=checkpoint_every,
            progress_bar=progress_bar,
        ).run()


@contextlib.contextmanager
def _owned(run: RunFolder) -> Iterator[None]:
    """Own a run's folder; if the disk refuses a file, say what is safe and how to go on."""
    with run.owned():
        try:
            yield
        except Exception as error:
            refusal = disk_refusal(error)
            if refusal is None:
                raise
            saved = Checkpoint.read(run.checkpoint_dir)
            safe = (
                "It had saved nothing yet."
                if saved is None
                else f"Its last whole checkpoint, after {saved.num_timesteps} steps, is safe."
            )
            raise RunError(
                f"Run '{run.path}' cannot be written any more: {refusal}. {safe} When "
                f"there is room, go on with: sb3-piano train --resume {shlex.quote(str(run.path))}"
            ) from error


def _check_expected(
    run: RunFolder, config: RunConfig, algo: str | None, env_id: str | None
) -> None:
    expected = {"algo": algo, "env_id": None if env_id is None else registered_id(env_id)[1]}
    for name, value in expected.items():
        actual = getattr(config, name)
        if value is not None and value != actual:
            raise ConfigError(
                f"Run '{run.path}' has {name} {actual!r}, not {value!r}: expected the same, or a "
                "new run."
            )


def _check_labels(run: RunFolder, config: RunConfig, saved: Checkpoint | None) -> None:
    for name, value in ({} if saved is None else saved.labels).items():
        actual = getattr(config, name, None)
        if value != actual:
            raise RunError(
                f"The checkpoint in '{run.checkpoint_dir}' is of a run with {name} {value!r}, but "
                f"'{run.config_file}' has {actual!r}: expected the files of one run."
            )


def _fresh(run: RunFolder, config: RunConfig, venv: VecEnv) -> BaseAlgorithm:
    """Return a new model for a run that stopped before anything was saved."""
    _log.warning("Run '%s' had saved nothing yet: it starts over at step 0.", run.path)
    model = build_model(config, venv)
    for leftover in (run.monitor_dir, run.tensorboard_dir):
        shutil.rmtree(leftover, ignore_errors=True)
    return model


def _played_on(env: gym.Env[Any, Any], *, steps: int) -> gym.Env[Any, Any]:
    """Let a piano count on from the control steps that were played before."""
    if isinstance(env.unwrapped, PianoEnv):
        env.unwrapped.total_steps = steps
    return env


def _restored(run: RunFolder, config: RunConfig, saved: Checkpoint, venv: VecEnv) -> BaseAlgorithm:
    model = load_model(config, run.checkpoint_dir / saved.model, venv)
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None and saved.replay is not None:
        restore_replay_buffer(buffer, run.checkpoint_dir, saved.replay)
        end_last_episode(buffer)
    entropy = (config.seed or 0, saved.num_timesteps)
    model.set_random_seed(int(np.random.SeedSequence(entropy).generate_state(1)[0]))
    return model


@contextlib.contextmanager
def _closing(venv: VecEnv) -> Iterator[VecEnv]:
    try:
        yield venv
    finally:
        # Closing must not hide why an environment's process has gone.
        with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
            venv.close()
