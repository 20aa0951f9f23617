"""Start a training from the model of another run."""

from __future__ import annotations

import dataclasses
import logging
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.save_util import recursive_getattr
from stable_baselines3.common.type_aliases import TrainFreq, TrainFrequencyUnit
from stable_baselines3.common.vec_env import VecNormalize, unwrap_vec_normalize
from torch.optim import Optimizer

from sb3_piano.callbacks.checkpoint import Checkpoint
from sb3_piano.callbacks.replay_segments import end_last_episode, restore_replay_buffer
from sb3_piano.exceptions import ConfigError, RunError, one_line
from sb3_piano.settings import Index, checked
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.env_spec import FILE_OPTIONS
from sb3_piano.training.configuration.names import registered_id
from sb3_piano.training.configuration.plugins import Plugin
from sb3_piano.training.configuration.yaml_files import load_config
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import load_statistics, model_files

_log = logging.getLogger(__name__)

_START = "sb3_piano.training.StartFromRun"

# SB3's names of the learnt entropy coefficient of SAC, TQC and CrossQ.
_ENTROPY, _ENTROPY_OPTIMIZER = "log_ent_coef", "ent_coef_optimizer"


class StartFromRun(BaseCallback):
    """Load the learnt state of another run's model before the training.

    It copies networks, the moments of their optimizers, the entropy coefficient (unless
    ``with_entropy`` is false) and the statistics of ``VecNormalize``; options of optimizers, such
    as ``critic_first``, are the training's own. ``learning_starts`` is ignored and no action is
    random: the policy fills the replay buffer itself, for ``seed_steps`` without an update, unless
    ``with_buffer`` is true. A resumed training keeps its own networks.

    ``sb3-piano train --init-from RUN`` adds this callback to a run.

    Source: RoboVirtuoso (2023), section 4.2: "when seeding the replay buffer when finetuning, we
    sample from the model rather than choosing actions randomly".

    Args:
        run: Folder of the run, of the same algorithm, policy and spaces.
        with_buffer: Whether to copy its replay buffer.
        seed_steps: Environment steps before the first update; by default the batch size.
        with_entropy: Whether to copy its entropy coefficient. Otherwise a learnt coefficient is
            reset: the policy explores as in a new training.

    Raises:
        ConfigError: When training starts, if the model does not fit, has no replay buffer, or
            learns no entropy coefficient to reset.
        RunError: If the folder is no run, or lacks the saved state.
    """

    def __init__(
        self,
        run: str | os.PathLike[str],
        with_buffer: bool = False,
        seed_steps: int | None = None,
        with_entropy: bool = True,
    ) -> None:
        super().__init__()
        self._run = os.fspath(run)
        self._with_buffer: bool = checked("with_buffer", with_buffer, bool)
        self._seed_steps: int | None = checked("seed_steps", seed_steps, Index | None)
        self._with_entropy: bool = checked("with_entropy", with_entropy, bool)
        self._train_freq: Any = None

    def _init_callback(self) -> None:
        # Earlier than the start of training: checkpoints read the buffer when initialised.
        if self.model.num_timesteps == 0:
            run = RunFolder.open(self._run)
            config = run.read_config()
            if not self._with_entropy and getattr(self.model, _ENTROPY, None) is None:
                raise without_learnt_entropy(type(self.model))
            if config.algorithm is not type(self.model):
                raise ConfigError(
                    f"Run '{run.path}' is of {config.algo!r}, this training of "
                    f"{type(self.model).__name__}: expected a run of the same algorithm."
                )
            self._take_over(run, config)
            if self._with_buffer:
                self._take_buffer(run)
            _log.info("Loaded networks and optimizers of run '%s'.", run.path)
        if isinstance(self.model, OffPolicyAlgorithm):
            self.model.learning_starts = 0

    def _on_training_start(self) -> None:
        model = self.model
        if self.num_timesteps > 0 or not isinstance(model, OffPolicyAlgorithm):
            return
        steps = model.batch_size if self._seed_steps is None else self._seed_steps
        if self._with_buffer or steps == 0:
            return
        # Updates follow a rollout, so the first rollout is as long as the seeding.
        self._train_freq = model.train_freq
        calls = math.ceil(steps / model.n_envs)
        model.train_freq = TrainFreq(calls, TrainFrequencyUnit.STEP)  # type: ignore[assignment]

    def _on_rollout_end(self) -> None:
        if self._train_freq is not None:
            assert isinstance(self.model, OffPolicyAlgorithm), "only these are seeded"
            self.model.train_freq, self._train_freq = self._train_freq, None

    def _on_training_end(self) -> None:
        self._on_rollout_end()  # SB3 skips it if a callback ends the training

    def _on_step(self) -> bool:
        return True

    def _take_over(self, run: RunFolder, config: RunConfig) -> None:
        """Copy networks, optimizers, entropy coefficient and statistics."""
        if run.weights_file.is_file():
            raise RunError(
                f"Run '{run.path}' was exported to be played, without the states of optimizers "
                "and critics: expected the original run."
            )
        file, statistics = model_files(run, config)
        off_policy = issubclass(config.algorithm, OffPolicyAlgorithm)
        small: dict[str, Any] = {"buffer_size": 1} if off_policy else {}
        try:
            source = config.algorithm.load(file, device=self.model.device, **small)
        except Exception as error:  # unpickling fails in any way
            raise RunError(
                f"Model '{file}' cannot be loaded ({one_line(error)}): expected a model that "
                f"{config.algorithm.__name__} saved."
            ) from error
        self._check_spaces(run, source)
        options = [dict(group, params=None) for group in self._groups()]
        parameters = source.get_parameters()
        if not self._with_entropy:
            own_entropy = self.model.get_parameters()[_ENTROPY_OPTIMIZER]
            parameters[_ENTROPY_OPTIMIZER] = own_entropy
        try:
            self.model.set_parameters(parameters)  # type: ignore[arg-type]
        except (RuntimeError, ValueError, KeyError, AttributeError) as error:
            raise ConfigError(
                f"The networks of run '{run.path}' do not fit ({one_line(error)}): expected its "
                f"policy {config.policy!r} with policy_kwargs "
                f"{config.algorithm_kwargs.get('policy_kwargs', {})}, and its ent_coef."
            ) from error
        for group, own in zip(self._groups(), options, strict=True):
            group.update(own, params=group["params"])
        for name in source._get_torch_save_params()[1]:
            learnt = getattr(source, name)
            # A fixed coefficient is the config's.
            if learnt.requires_grad and (self._with_entropy or name != _ENTROPY):
                getattr(self.model, name).data.copy_(learnt.data)
        self._take_statistics(run, config, statistics)

    def _groups(self) -> Iterator[dict[str, Any]]:
        """Yield the parameter groups of all optimizers, with their options."""
        for name in self.model._get_torch_save_params()[0]:
            part = recursive_getattr(self.model, name)
            if isinstance(part, Optimizer):
                yield from part.param_groups

    def _check_spaces(self, run: RunFolder, source: BaseAlgorithm) -> None:
        for name in ("observation_space", "action_space"):
            theirs, ours = getattr(source, name), getattr(self.model, name)
            if theirs != ours:
                raise ConfigError(
                    f"Run '{run.path}' has the {name} {theirs}, this training {ours}: expected "
                    "equal ones, of the same wrappers and an observation that does not go by the "
                    "piece, such as 'roll'."
                )

    def _take_statistics(self, run: RunFolder, config: RunConfig, file: Path | None) -> None:
        normalizer = unwrap_vec_normalize(self.model.get_env())  # type: ignore[arg-type]
        if (file is None) != (normalizer is None):
            does = "does not normalise" if file is None else "normalises"
            raise ConfigError(
                f"Run '{run.path}' {does} observations and rewards, unlike this training: "
                "expected the same 'normalize' in both."
            )
        if isinstance(normalizer, VecNormalize):
            load_statistics(config, file, normalizer)

    def _take_buffer(self, run: RunFolder) -> None:
        buffer = getattr(self.model, "replay_buffer", None)
        saved = Checkpoint.read(run.checkpoint_dir)
        if buffer is None or saved is None or saved.replay is None:
            raise ConfigError(
                f"There is no replay buffer to take from run '{run.path}': expected an off-policy "
                "algorithm and a run with its checkpoint, or no with_buffer."
            )
        restore_replay_buffer(buffer, run.checkpoint_dir, saved.replay)
        end_last_episode(buffer)  # a new one begins


def without_learnt_entropy(algorithm: type[BaseAlgorithm]) -> ConfigError:
    """Return the error of a training without a learnt entropy coefficient."""
    return ConfigError(
        f"with_entropy is false, but this {algorithm.__name__} learns no entropy coefficient: "
        "expected SAC, TQC or CrossQ with an ent_coef such as auto, or no with_entropy."
    )


def start_plugin(
    run: str | os.PathLike[str], with_buffer: bool = False, with_entropy: bool = True
) -> Plugin:
    """Return the plugin of :class:`StartFromRun` for the run in a folder."""
    kwargs: dict[str, Any] = {"run": os.path.abspath(run)}
    kwargs |= {"with_buffer": True} if with_buffer else {}
    kwargs |= {} if with_entropy else {"with_entropy": False}
    return Plugin(path=_START, kwargs=kwargs)


def load_start(
    run: str | os.PathLike[str],
    env_id: str | None = None,
    path: str | os.PathLike[str] | None = None,
    *,
    with_buffer: bool = False,
    **overrides: Any,
) -> RunConfig:
    """Return the settings of a training that starts from the model of a run.

    Args:
        run: The run's folder. Its settings are kept, including wrappers and observation.
        env_id: Id of another environment, or ``module:Id``; by default the run's own.
        path: Hyperparameters that replace the run's, as in :func:`load_config`.
        with_buffer: Whether to copy its replay buffer.
        **overrides: Settings that replace the run's. ``env_kwargs`` are added to the run's. For
            another piece, the run's score, its file of finger labels and wrappers that choose a
            piece, such as :class:`~sb3_piano.wrappers.RandomPiece`, are dropped.

    Raises:
        ConfigError: As in :func:`load_config`, or if the run is not trained.
        RunError: If the folder is no run.
    """
    folder = RunFolder.open(run)
    config = folder.read_config()
    start = start_plugin(folder.path, with_buffer)
    given = overrides.pop("env_kwargs", {})
    another = env_id is not None and registered_id(env_id)[1] != config.env_id
    others = another or "score" in given or bool(overrides.get("pieces"))
    if not others:
        overrides.setdefault("pieces", config.pieces)
    env_id = config.env.full_id if env_id is None else env_id
    if path is not None:
        if not others:  # the run's piece is no hyperparameter
            kept = {*FILE_OPTIONS, *config.env.piece_options}
            own = {name: value for name, value in config.env_kwargs.items() if name in kept}
            given = {**own, **given}
        config = load_config(config.algo, env_id, path, env_kwargs=given, **overrides)
        return dataclasses.replace(config, callback=(*config.callback, start))
    callbacks = tuple(plugin for plugin in config.callback if plugin.path != _START)
    module, name = registered_id(env_id)
    config = config.with_env(config.env.for_others()) if others else config
    changed = {"callback": (*callbacks, start), "pieces": (), "seed": None, **overrides}
    changed |= {"env_id": name, "env_module": module, "env_kwargs": {**config.env_kwargs, **given}}
    return dataclasses.replace(config, **changed)
