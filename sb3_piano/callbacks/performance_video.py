"""Callback that films the model during a training."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
from gymnasium.wrappers import TimeLimit

from sb3_piano.callbacks.own_env import (
    OwnEnvCallback,
    RunContext,
    env_name,
    preserve_random_state,
    sync_normalization,
)
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.links import make_folder
from sb3_piano.players import EpisodeRecorder
from sb3_piano.players.rollout import rollout
from sb3_piano.settings import Positive, Unit, checked
from sb3_piano.take import Take, write_take
from sb3_piano.viewing import Picture, View


class PerformanceVideoCallback(OwnEnvCallback):
    """Play an episode at intervals, and save it as a video with sound.

    Every ``video_freq`` calls the deterministic policy plays in an environment of its own.
    ``step_<n>.mp4`` has pictures and sound, ``step_<n>.wav`` the sound and ``step_<n>.mid`` the
    notes, unless no key was pressed; n is the number of environment steps. A machine that cannot
    draw writes the other two, and one warning.

    A call is one step of all environments together: with ``n_envs`` environments, ``video_freq``
    calls are ``video_freq * n_envs`` environment steps. Environment and random generators are the
    callback's own, so the training stays the same.

    Args:
        video_freq: Calls between two videos; 0 for none at all.
        folder: Where to write. By default ``videos`` in the folder of a run by ``sb3-piano train``;
            elsewhere it has to be given.
        max_seconds: Longest part of the piece to play, s.
        width: Width of the picture, an even number of pixels, at most 1920.
        height: Height of the picture, an even number of pixels, at most 1080.
        view: "stage", "close", "top" or "roll".
        seed: Seeds the environment of each episode, so that videos are comparable; ``None`` lets
            it go on from the last one.

    Raises:
        ConfigError: If a setting is out of range; when training starts, if there is no folder, the
            environment is no piano, or it is in another process and there is no run to make one.
    """

    def __init__(
        self,
        video_freq: int,
        folder: str | None = None,
        *,
        max_seconds: float = 60.0,
        width: int = 640,
        height: int = 360,
        view: View = "stage",
        seed: int | None = 0,
    ) -> None:
        super().__init__()
        self._video_freq = video_freq
        self._folder = None if folder is None else Path(folder)
        self._max_seconds = checked("max_seconds", max_seconds, Annotated[Positive, Unit("s")])
        self._picture: Picture | None = Picture(width=width, height=height, view=view)
        self._seed = seed

    def use_run(self, run: RunContext) -> None:
        """Set the environment, and the folder of the videos, from a run."""
        super().use_run(run)
        if self._folder is None:
            self._folder = run.folder / "videos"

    def _init_callback(self) -> None:
        if self._folder is None:
            raise ConfigError(
                "PerformanceVideoCallback has no folder to write into: expected folder='...', "
                "which only a training by 'sb3-piano train' can do without."
            )
        venv = self._make_own_env(self._record)
        piano = self._recorder.unwrapped
        if not isinstance(piano, PianoEnv):
            raise ConfigError(
                f"There is no performance to record in {env_name(venv)}: expected a piano "
                "environment."
            )
        make_folder(self._folder)

    def _on_step(self) -> bool:
        if self._video_freq > 0 and self.n_calls % self._video_freq == 0:
            assert self._folder is not None, "a training is on"
            self._write(self.play(), self._folder / f"step_{self.num_timesteps}")
        return True

    def play(self) -> Take:
        """Play an episode with the present model in the callback's environment."""
        assert self._own_env is not None, "a training is on"
        sync_normalization(self.model, self._own_env)
        with preserve_random_state(self.model, self._seed):
            return next(rollout(self.model, self._own_env, seed=self._seed))

    def _record(self, env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        """Wrap the inner environment with a recorder and a time limit."""
        if isinstance(env.unwrapped, PianoEnv):
            steps = int(self._max_seconds / env.unwrapped.config.control_timestep + 1e-9)
            env = TimeLimit(env, max(steps, 1))
        self._recorder = EpisodeRecorder(env)
        return self._recorder

    def _write(self, take: Take, base: Path) -> None:
        played = write_take(take, base, self._picture)
        if played.problem is not None:
            self._picture = None
            warnings.warn(
                f"There are no videos of this training, only sound and notes: {played.problem}",
                stacklevel=2,
            )
