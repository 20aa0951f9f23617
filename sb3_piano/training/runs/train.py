"""Train a model from a config, and resume a training."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import logging
import os
import shlex
import shutil
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, CallbackList
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.batch import BatchVecEnv
from sb3_piano.callbacks import EpisodeMetricsCallback, RewardTermsCallback
from sb3_piano.callbacks.checkpoint import DEFAULT_EVERY, Checkpoint, ResumableCheckpoint
from sb3_piano.callbacks.own_env import EnvWrapper, RunContext, set_run_context
from sb3_piano.callbacks.progress import PianoProgressBar
from sb3_piano.callbacks.replay_segments import end_last_episode, restore_replay_buffer
from sb3_piano.exceptions import ConfigError, RunError, SB3PianoError
from sb3_piano.files import disk_refusal
from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.links import check_inside
from sb3_piano.policies import fast_updates
from sb3_piano.settings import Count, checked
from sb3_piano.threads import torch_computing
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.names import registered_id
from sb3_piano.training.playing.player_files import keep_base
from sb3_piano.training.runs.builders import build_callbacks, build_model, build_vec_env
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import load_model, load_statistics

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class TrainResult:
    """Result of a training."""

    folder: RunFolder
    """Folder of all files."""
    started_at: int
    """Environment steps before this training."""
    num_timesteps: int
    """Environment steps after this training."""
    n_timesteps: int
    """Total environment steps requested."""
    interrupted: bool = False
    """Whether Ctrl-C or SIGTERM ended it early."""

    @property
    def had_finished(self) -> bool:
        """Whether all steps were already done."""
        return self.started_at >= self.n_timesteps


def train(
    config: RunConfig,
    folder: str | os.PathLike[str] | None = None,
    *,
    runs_dir: str | os.PathLike[str] = "runs",
    callbacks: Sequence[BaseCallback] = (),
    progress_bar: bool = True,
    checkpoint_every: int | None = None,
) -> TrainResult:
    """Train a new model.

    The folder is made after environment and model work, and is deleted if a callback raises an
    error before the first step. Ctrl-C or SIGTERM ends the training with a checkpoint; after any
    other end :func:`resume` continues from the last checkpoint.

    Args:
        config: Settings of the training; without a seed, one is drawn and saved.
        folder: The run's folder, new or empty; by default the next free one in ``runs_dir``.
        runs_dir: Folder of all runs.
        callbacks: Callbacks besides the config's. They are not saved in the run's folder, so
            :func:`resume` does not restore them.
        progress_bar: Whether to show progress on the terminal.
        checkpoint_every: Environment steps between two checkpoints; by default 10,000, and of a
            batch at least 1,000 of each agent.

    Raises:
        ConfigError: If environment, algorithm or callbacks refuse their settings.
        RunError: If the folder cannot be used.
    """
    checked("checkpoint_every", checkpoint_every, Count | None)
    if config.seed is None:
        config = dataclasses.replace(config, seed=int(np.random.default_rng().integers(2**31)))
    with (
        torch_computing(config.num_threads, config.matmul_precision),
        _closing(build_vec_env(config)) as venv,
    ):
        model, every_callback = build_model(config, venv), [*build_callbacks(config), *callbacks]
        with RunFolder.making(config, folder, runs_dir) as run:
            keep_base(run, config)
        with _owned(run):
            try:
                return _learn(
                    config, run, model, every_callback, None, checkpoint_every, progress_bar
                )
            except SB3PianoError:  # such as from a callback that does not fit the model
                if model.num_timesteps == 0:
                    shutil.rmtree(run.path, ignore_errors=True)
                raise


def resume(
    folder: str | os.PathLike[str],
    steps: int | None = None,
    *,
    algo: str | None = None,
    env_id: str | None = None,
    callbacks: Sequence[BaseCallback] = (),
    progress_bar: bool = True,
    checkpoint_every: int | None = None,
) -> TrainResult:
    """Resume a run from its last checkpoint: model, replay buffer, step count, callbacks.

    Callbacks with a state, such as :class:`~sb3_piano.callbacks.LevelReplayCallback`, restore it;
    the others start anew.

    A new episode begins, and the random seed is derived from the run's seed and the step count: two
    resumptions of one checkpoint are equal, but differ from a run without a stop. Schedules by
    ``PianoEnv.total_steps``, as in wrappers, continue.

    A run that stopped before its first checkpoint starts over. A finished run returns at once, see
    ``had_finished`` of the result.

    Args:
        folder: The run's folder.
        steps: New total of environment steps; by default the run's.
        algo: Expected algorithm of the run, if any.
        env_id: Expected environment of the run, if any.
        callbacks: As in :func:`train`.
        progress_bar: Whether to show progress on the terminal.
        checkpoint_every: As in :func:`train`.

    Raises:
        ConfigError: If the run's config is damaged, or its environment cannot be made.
        RunError: If there is no run, it is not as expected, or its checkpoint is damaged.
    """
    checked("checkpoint_every", checkpoint_every, Count | None)
    run = RunFolder.open(folder)
    if run.weights_file.is_file():
        raise RunError(
            f"Run '{run.path}' was exported to be played, without what training needs: expected "
            "the original run."
        )
    with _owned(run):
        config = run.read_config()
        expected = {"algo": algo, "env_id": None if env_id is None else registered_id(env_id)[1]}
        for name, actual in config.labels.items():
            if expected[name] not in (None, actual):
                raise ConfigError(
                    f"Run '{run.path}' has {name} {actual!r}, not {expected[name]!r}: expected the "
                    "same, or a new run."
                )
        if steps is not None:
            config = dataclasses.replace(config, n_timesteps=steps)
        saved = Checkpoint.read(run.checkpoint_dir)
        for name, value in ({} if saved is None else saved.labels).items():
            if value != config.labels.get(name):
                raise RunError(
                    f"The checkpoint in '{run.checkpoint_dir}' is of a run with {name} {value!r}, "
                    f"but '{run.config_file}' has {config.labels.get(name)!r}: expected the files "
                    "of one run."
                )
        done = 0 if saved is None else saved.num_timesteps
        if saved is not None:  # a process may have been killed before copying it
            saved.copy_model(run.checkpoint_dir, run.model_file)
        if done >= config.n_timesteps:
            return TrainResult(
                folder=run, started_at=done, num_timesteps=done, n_timesteps=config.n_timesteps
            )
        with (
            torch_computing(config.num_threads, config.matmul_precision),
            _closing(build_vec_env(config)) as venv,
        ):
            venv.unwrapped.env_method("count_on", done // venv.num_envs)
            model = _restored(run, config, saved, venv)
            every = [*build_callbacks(config), *callbacks]
            run.forget_unfinished()
            run.write_config(config)
            return _learn(config, run, model, every, saved, checkpoint_every, progress_bar)


def _learn(
    config: RunConfig,
    run: RunFolder,
    model: BaseAlgorithm,
    callbacks: Sequence[BaseCallback],
    resumed: Checkpoint | None,
    checkpoint_every: int | None,
    progress_bar: bool,
) -> TrainResult:
    """Train in a run's folder up to the config's number of steps.

    Ctrl-C and SIGTERM end the training with a checkpoint. Other exceptions leave the last
    checkpoint unchanged.
    """
    started_at = model.num_timesteps
    _open_logs(run, model, append=resumed is not None)
    device = config.algorithm_kwargs.get("device")
    if str(device).startswith("cuda") and model.device.type == "cpu":  # SB3 says nothing
        _log.warning("device is %r, but torch finds no GPU: the training runs on the CPU.", device)

    def another_env(innermost: EnvWrapper | None) -> VecEnv:
        return build_vec_env(config.alone(), innermost=innermost)

    set_run_context(RunContext(folder=run.path, make_env=another_env), callbacks)
    if resumed is not None:
        resumed.restore_callbacks(callbacks)
    least = max(DEFAULT_EVERY, 1000 * config.n_agents)
    own: list[BaseCallback] = [EpisodeMetricsCallback(), RewardTermsCallback()]
    with contextlib.ExitStack() as stack:
        stack.callback(_close_logger, model)
        stack.enter_context(fast_updates(model))
        if progress_bar:
            own.append(stack.enter_context(contextlib.closing(PianoProgressBar())))
        own.append(
            ResumableCheckpoint(
                run.checkpoint_dir,
                checkpoint_every or (least if config.is_batched else DEFAULT_EVERY),
                model_copy=run.model_file,
                labels=config.labels,
                resumed=resumed,
                callbacks=callbacks,
            )
        )
        request = stack.enter_context(stop_on_signal())
        bookends = _Bookends()
        every = CallbackList([bookends, *callbacks, *own, _StopOnRequest(request)])
        try:
            model.learn(
                config.n_timesteps - model.num_timesteps,
                callback=every,
                tb_log_name="run",
                reset_num_timesteps=resumed is None,
            )
        except KeyboardInterrupt:
            request.made = True
            if bookends.started:
                every.on_training_end()  # SB3 skips it; it saves the last checkpoint
        except KeyError as error:
            if error.args and error.args[0] in config.monitor_kwargs.get("info_keywords", ()):
                raise ConfigError(
                    f"monitor_kwargs: info_keywords has {error.args[0]!r}, which the info of "
                    f"{config.env_id!r} lacks at the end of an episode: expected names in it."
                ) from error
            raise
    return TrainResult(
        folder=run,
        started_at=started_at,
        num_timesteps=model.num_timesteps,
        n_timesteps=config.n_timesteps,
        interrupted=request.made and model.num_timesteps < config.n_timesteps,
    )


def _open_logs(run: RunFolder, model: BaseAlgorithm, *, append: bool) -> None:
    """Direct Monitor files and TensorBoard logs to the run's folder."""
    venv = model.get_env()
    assert venv is not None, "a model that trains has its environments"
    for place in (run.monitor_dir, run.tensorboard_dir):
        for log in (place, *place.rglob("*")):
            check_inside(log)  # SB3 writes there without this check
    bare = venv.unwrapped  # a wrapper may show more agents than there are environments
    for index in range(1 if isinstance(bare, BatchVecEnv) else bare.num_envs):
        path = str(run.monitor_dir / str(index))
        bare.env_method("write_episodes_to", path, append, indices=[index])
    if importlib.util.find_spec("tensorboard") is None:
        warnings.warn(
            "TensorBoard is not installed, so that the training is not logged: "
            "pip install tensorboard",
            stacklevel=3,
        )
        return
    model.tensorboard_log = str(run.tensorboard_dir)


def _close_logger(model: BaseAlgorithm) -> None:
    """Close the logger, and with it TensorBoard's writer thread."""
    if hasattr(model, "_logger"):  # set when learning starts
        model.logger.close()


class _Bookends(BaseCallback):
    """Record that training began, and write SB3's pending log values at its end."""

    started = False

    def _on_training_start(self) -> None:
        self.started = True

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        if self.logger.name_to_value:
            self.model.dump_logs()


class _StopOnRequest(BaseCallback):
    """End the training after a request, by raising ``KeyboardInterrupt`` between two rollouts.

    Within a rollout the last step of off-policy algorithms is counted but not yet in the replay
    buffer. On-policy algorithms discard an unfinished rollout, so they end at once, except after
    the last step of a training: its rollout is still learnt from.
    """

    def __init__(self, request: StopRequest) -> None:
        super().__init__()
        self._request = request

    def _on_rollout_start(self) -> None:
        if self._request.made:
            raise KeyboardInterrupt

    def _on_step(self) -> bool:
        if not self._request.made or not isinstance(self.model, OnPolicyAlgorithm):
            return True
        return self.model.num_timesteps >= self.model._total_timesteps


@contextlib.contextmanager
def _owned(run: RunFolder) -> Iterator[None]:
    """Lock a run's folder; a full disk raises a RunError that says how to resume."""
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


@contextlib.contextmanager
def _closing(venv: VecEnv) -> Iterator[VecEnv]:
    try:
        yield venv
    finally:
        # Errors of closing must not hide why an environment's process ended.
        with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
            venv.close()


def _restored(
    run: RunFolder, config: RunConfig, saved: Checkpoint | None, venv: VecEnv
) -> BaseAlgorithm:
    """Load a checkpoint's model; without a checkpoint, build a new one."""
    if saved is None:
        _log.warning("Run '%s' had saved nothing yet: it starts over at step 0.", run.path)
        model = build_model(config, venv)
        for leftover in (run.monitor_dir, run.tensorboard_dir):
            shutil.rmtree(leftover, ignore_errors=True)
        return model
    if saved.vec_normalize is not None:
        load_statistics(config, run.checkpoint_dir / saved.vec_normalize, venv)
    model = load_model(config, run.checkpoint_dir / saved.model, venv)
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None and saved.replay is not None:
        restore_replay_buffer(buffer, run.checkpoint_dir, saved.replay)
        end_last_episode(buffer)
    entropy = (config.seed or 0, saved.num_timesteps)
    model.set_random_seed(int(np.random.SeedSequence(entropy).generate_state(1)[0]))
    return model
