"""One sitting of training: ``learn`` with the run's callbacks, until its end or an interruption."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, CallbackList
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.callbacks import (
    Checkpoint,
    EpisodeMetricsCallback,
    PianoProgressBar,
    ResumableCheckpoint,
    RewardTermsCallback,
)
from sb3_piano.callbacks.checkpoint import DEFAULT_EVERY
from sb3_piano.callbacks.own_env import EnvWrapper, RunContext, hand_over
from sb3_piano.exceptions import ConfigError
from sb3_piano.training.builders import build_vec_env
from sb3_piano.training.config import RunConfig
from sb3_piano.training.interrupts import StopOnRequest, stop_on_signal
from sb3_piano.training.run_folder import RunFolder

_LOG_NAME = "run"


@dataclass(frozen=True, kw_only=True)
class TrainResult:
    """How a training ended."""

    folder: RunFolder
    """Where everything is."""
    started_at: int
    """Environment steps that were done before."""
    num_timesteps: int
    """Environment steps that are done now."""
    n_timesteps: int
    """Environment steps that were asked for in all."""
    interrupted: bool = False
    """Whether Ctrl-C or SIGTERM ended it early."""

    @property
    def had_finished(self) -> bool:
        """Whether there was nothing left to do."""
        return self.started_at >= self.n_timesteps


@dataclass(frozen=True, kw_only=True)
class Session:
    """A model that is ready to train in a run's folder."""

    config: RunConfig
    folder: RunFolder
    model: BaseAlgorithm
    callbacks: Sequence[BaseCallback] = ()
    """Callbacks of the user."""
    resumed: Checkpoint | None = None
    """The checkpoint from which the model was restored."""
    checkpoint_every: int = DEFAULT_EVERY
    """Environment steps between two checkpoints."""
    progress_bar: bool = True
    """Whether to show progress on the terminal."""

    def run(self) -> TrainResult:
        """Train until the config's number of steps is done.

        Ctrl-C and SIGTERM end the training with a checkpoint. After any other exception the last
        checkpoint stays as it is.

        Raises:
            ConfigError: If the environment's ``info`` lacks one of ``info_keywords``.
        """
        started_at = self.model.num_timesteps
        self._open_logs()
        hand_over(RunContext(folder=self.folder.path, make_env=self._another_env), self.callbacks)
        with contextlib.ExitStack() as stack:
            stack.callback(self._close_logger)
            bar = self._progress_bar(stack)
            request = stack.enter_context(stop_on_signal())
            own = [EpisodeMetricsCallback(), RewardTermsCallback(), bar, self._saver()]
            stopper = StopOnRequest(request)
            callbacks = [*self.callbacks, *filter(None, own), stopper]
            interrupted = self._learn(callbacks) or request.made
        done = self.model.num_timesteps
        return TrainResult(
            folder=self.folder,
            started_at=started_at,
            num_timesteps=done,
            n_timesteps=self.config.n_timesteps,
            interrupted=interrupted and done < self.config.n_timesteps,
        )

    def _learn(self, callbacks: list[BaseCallback]) -> bool:
        """Return whether ``KeyboardInterrupt`` ended the training."""
        bookends = _Bookends()
        every = CallbackList([bookends, *callbacks])
        try:
            self.model.learn(
                self.config.n_timesteps - self.model.num_timesteps,
                callback=every,
                tb_log_name=_LOG_NAME,
                reset_num_timesteps=self.resumed is None,
            )
        except KeyboardInterrupt:
            if bookends.started:
                every.on_training_end()  # SB3 leaves this out; it saves the last checkpoint
            return True
        except KeyError as error:
            self._explain_missing_keyword(error)
            raise
        return False

    def _another_env(self, innermost: EnvWrapper | None) -> VecEnv:
        """Return an environment like those of the training, alone and without log files."""
        config = dataclasses.replace(self.config, n_envs=1, vec_env="dummy", monitor_kwargs={})
        return build_vec_env(config, innermost=innermost)

    def _progress_bar(self, stack: contextlib.ExitStack) -> PianoProgressBar | None:
        if not self.progress_bar:
            return None
        return stack.enter_context(contextlib.closing(PianoProgressBar()))

    def _saver(self) -> ResumableCheckpoint:
        return ResumableCheckpoint(
            self.folder.checkpoint_dir,
            self.checkpoint_every,
            model_copy=self.folder.model_file,
            labels={"algo": self.config.algo, "env_id": self.config.env_id},
            resumed=self.resumed,
        )

    def _open_logs(self) -> None:
        """Let Monitor files and TensorBoard logs be written into the run's folder."""
        venv = self.model.get_env()
        assert venv is not None, "a session's model has its environments"
        for index in range(venv.num_envs):
            path = str(self.folder.monitor_dir / str(index))
            append = self.resumed is not None
            venv.env_method("write_episodes_to", path, append, indices=[index])
        if importlib.util.find_spec("tensorboard") is None:
            warnings.warn(
                "TensorBoard is not installed, so that the training is not logged: "
                "pip install tensorboard",
                stacklevel=3,
            )
            return
        self.model.tensorboard_log = str(self.folder.tensorboard_dir)

    def _close_logger(self) -> None:
        """End the thread in which TensorBoard writes."""
        if hasattr(self.model, "_logger"):  # which the model has once it learns
            self.model.logger.close()

    def _explain_missing_keyword(self, error: KeyError) -> None:
        keywords = self.config.monitor_kwargs.get("info_keywords", ())
        if error.args and error.args[0] in keywords:
            raise ConfigError(
                f"monitor_kwargs: info_keywords has {error.args[0]!r}, which the info of "
                f"{self.config.env_id!r} lacks at the end of an episode: expected names in it."
            ) from error


class _Bookends(BaseCallback):
    """Know that training began, and log at its end what SB3 still holds back."""

    started = False

    def _on_training_start(self) -> None:
        self.started = True

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        if self.logger.name_to_value:
            self.model.dump_logs()
