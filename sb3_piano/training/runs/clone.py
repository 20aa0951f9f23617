"""Behavioural cloning of recorded performances into a run."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from sb3_piano.callbacks.checkpoint import Checkpoint
from sb3_piano.demonstrations import Cloning, clone_behaviour
from sb3_piano.demonstrations.corpus import RecordedCorpus, open_recorded
from sb3_piano.demonstrations.dataset import reading
from sb3_piano.demonstrations.streaming import DEFAULT_BUFFER
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import DEFAULT_ALGORITHM
from sb3_piano.threads import torch_computing
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.plugins import Plugin
from sb3_piano.training.configuration.yaml_files import load_config
from sb3_piano.training.runs.builders import build_model, build_vec_env
from sb3_piano.training.runs.folder import RunFolder

if TYPE_CHECKING:
    from minari import MinariDataset

CLONABLE = ("sac", "td3", "tqc", "ddpg")
"""Names of the algorithms that support cloning."""

_PREFILL = "sb3_piano.callbacks.DemonstrationsCallback"


@dataclass(frozen=True, kw_only=True)
class CloneResult:
    """Result of :func:`clone`."""

    folder: RunFolder
    """The run's folder."""
    cloning: Cloning
    """Record of the actor's training."""


def clone(
    dataset: MinariDataset | RecordedCorpus | str,
    algo: str = DEFAULT_ALGORITHM,
    folder: str | os.PathLike[str] | None = None,
    *,
    runs_dir: str | os.PathLike[str] = "runs",
    config: str | os.PathLike[str] | None = None,
    net_arch: Sequence[int] = (512, 512),
    normalize: bool = True,
    prefill: bool = False,
    seed: int | None = None,
    epochs: int = 60,
    batch_size: int = 256,
    learning_rate: float = 1e-3,
    buffer: int = DEFAULT_BUFFER,
    on_epoch: Callable[[float], object] = lambda loss: None,
) -> CloneResult:
    """Train a model by behavioural cloning of a data set, in the data set's environment.

    The run has a model and 0 training steps: it can be played and evaluated, and resuming it trains
    the model further.

    Args:
        dataset: A Minari data set or its name, or a corpus or its folder. The run draws its pieces
            from a corpus's pieces.
        algo: Name of the algorithm, one of :data:`CLONABLE`.
        folder: The run's folder, new or empty; by default the next free one in ``runs_dir``.
        runs_dir: Folder of all runs.
        config: A YAML file of hyperparameters for later training; by default the algorithm's
            preset.
        net_arch: Sizes of the hidden layers.
        normalize: Whether to normalise observations with the data set's statistics. Without it, an
            actor plays much worse after the same time.
        prefill: Whether later training starts with the data set in the replay buffer and learns
            from it at once.
        seed: Seed of the run; by default drawn and saved.
        epochs: Number of passes over the data set.
        batch_size: Transitions per update.
        learning_rate: Initial learning rate.
        buffer: Transitions in memory; a larger corpus is read again in each epoch.
        on_epoch: Called with the loss of each epoch.

    Raises:
        ConfigError: If there is no such data set, it does not name its environment, or a setting is
            not valid.
        RunError: If the folder cannot be used.
        MissingPackageError: If Minari is not installed.
    """
    if algo not in CLONABLE:
        raise ConfigError(
            f"Behaviour cannot be cloned into algorithm {algo!r}: expected one of "
            f"{', '.join(CLONABLE)}."
        )
    found = open_recorded(dataset)
    if isinstance(found, RecordedCorpus):
        if prefill:
            raise ConfigError(
                f"prefill is set with the corpus in '{found.folder}': expected a single data set, "
                "which fits into a replay buffer."
            )
        name, recorded = str(found.folder.absolute()), found.dataset(found.shards[0])
    else:
        name, recorded = found.id, found
    spec = _environment(recorded)
    seed = int(np.random.default_rng().integers(2**31)) if seed is None else seed
    alone = {"n_envs": 1, "vec_env": "dummy"} | ({"learning_starts": 0} if prefill else {})
    normalized = {"norm_reward": False} if normalize else False
    settings = load_config(algo, spec.id, config, seed=seed, normalize=normalized, **alone)
    arguments = settings.algorithm_kwargs
    policy_kwargs = {**arguments.get("policy_kwargs", {}), "net_arch": list(net_arch)}
    filled = (Plugin(path=_PREFILL, kwargs={"dataset": name}),) if prefill else ()
    settings = _in_environment(spec, settings)
    if isinstance(found, RecordedCorpus) and settings.env_id == GENERAL_ID:
        options = {n: value for n, value in settings.env_kwargs.items() if n != "score"}
        settings = dataclasses.replace(settings, env_kwargs=options, pieces=found.pieces)
    settings = dataclasses.replace(
        settings,
        callback=(*filled, *settings.callback),
        algorithm_kwargs={**arguments, "policy_kwargs": policy_kwargs},
    )
    with (
        torch_computing(settings.num_threads, settings.matmul_precision),
        contextlib.closing(build_vec_env(settings)) as venv,
    ):
        model = build_model(settings, venv)
        with RunFolder.making(settings, folder, runs_dir) as run:
            # Without config.yml it is no run that could be resumed before its model exists.
            written = run.read_config()
            run.config_file.unlink()
            cloning = clone_behaviour(
                model,
                found,
                epochs=epochs,
                batch_size=batch_size,
                learning_rate=learning_rate,
                buffer=buffer,
                seed=seed,
                on_epoch=on_epoch,
            )
            run.checkpoint_dir.mkdir()  # the checkpoint of a training at step 0
            saved = Checkpoint.save(model, run.checkpoint_dir, settings.labels)
            saved.copy_model(run.checkpoint_dir, run.model_file)
            facts = {"dataset": name, "epochs": epochs, "batch_size": batch_size}
            facts |= {"learning_rate": learning_rate, "loss": cloning.losses[-1]}
            run.write_provenance({**run.read_provenance(), "cloned": facts})
            run.write_config(written)
    return CloneResult(folder=run, cloning=cloning)


def _environment(dataset: MinariDataset) -> EnvSpec:
    """Return the environment spec of a data set, without its perturbations."""
    if dataset.env_spec is None:
        raise ConfigError(
            f"Data set {dataset.id!r} does not tell its environment: expected one that 'sb3-piano "
            "record' wrote."
        )
    with (
        reading(dataset.id, Path(dataset.storage.data_path).parent),
        contextlib.closing(dataset.recover_environment(eval_env=True)) as env,
    ):
        assert env.spec is not None, "it was made from one"
        return env.spec


def _in_environment(spec: EnvSpec, config: RunConfig) -> RunConfig:
    """Return the settings with exactly an environment's arguments and wrappers."""
    registered = gym.spec(spec.id)
    unchanged = registered.kwargs.items()
    changed = {name: v for name, v in spec.kwargs.items() if (name, v) not in unchanged}
    if spec.max_episode_steps != registered.max_episode_steps:
        changed["max_episode_steps"] = spec.max_episode_steps
    wrappers = tuple(
        Plugin(path=wrapper.entry_point.replace(":", "."), kwargs=wrapper.kwargs or {})
        for wrapper in spec.additional_wrappers
    )
    return dataclasses.replace(config, env_kwargs=changed, env_wrapper=wrappers)
