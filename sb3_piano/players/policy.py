"""Base class of players, with the interface of a Stable-Baselines3 model."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_piano.arrays import BoolArray, Float32Array, IntArray
from sb3_piano.envs import ObservationSpace, PianoEnv
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    import torch
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.vec_env import VecEnv, VecNormalize


class PianoPolicy(ABC):
    """Base of players of any piece, with the interface of a Stable-Baselines3 model.

    It gets the hands' positions from the observation, the control step from ``state``, and the
    piece from its environment. It supports ``evaluate_policy`` and callbacks that evaluate or film:
    ``callback.init_callback(policy)`` works.

    Args:
        env: The environment, wrapped or not, or several of them in this process as a vector
            environment of Stable-Baselines3. Where hands are agents, it has an observation and an
            action for each hand.

    Raises:
        ConfigError: If it is no piano, or in another process.
    """

    num_timesteps = 0
    """Environment steps of its training; 0 without a network."""

    def __init__(self, env: gym.Env[Any, Any] | VecEnv) -> None:
        self._env = env
        self._pianos = pianos_of(env)
        self._agents = agents_of(env)
        self._logger: Logger | None = None
        self._normalizer = _normalizer_of(env)
        self._space = env.observation_space
        seen = self._space if self._normalizer is None else self._normalizer.venv.observation_space
        if self._agents > 1:
            seen = singles_of(env)[0].observation_space
        self._layout = seen.layout if isinstance(seen, ObservationSpace) else None

    # Importing torch and Stable-Baselines3 takes a second, and playing does not need them.

    @functools.cached_property
    def device(self) -> torch.device:
        """Device of the computations."""
        import torch

        return torch.device("cpu")

    @property
    def logger(self) -> Logger:
        """Logger of the callbacks."""
        if self._logger is None:
            from stable_baselines3.common.logger import Logger

            self._logger = Logger(folder=None, output_formats=[])
        return self._logger

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: BoolArray | None = None,
        deterministic: bool = False,
    ) -> tuple[Float32Array, Any]:
        """Choose the next action.

        Args:
            observation: One observation, or a row for each environment.
            state: State from the last call: the number of finished control steps, (n,). By default
                it is read from the environments of this player.
            episode_start: (n,) bool, whether each episode has just begun.
            deterministic: Ignored.

        Returns:
            The action or a row for each environment, float32; and the state for the next call.

        Raises:
            ConfigError: If the number of observations is not that of environments.
        """
        del deterministic
        rows, single = self._rows(observation)
        expected = len(self._pianos) * self._agents
        if len(rows) != expected:
            raise ConfigError(
                f"There are {len(rows)} observations: expected {expected}, one for each "
                f"{'environment' if self._agents == 1 else 'hand'} that this player was made for."
            )
        if self._normalizer is not None and isinstance(rows, np.ndarray):
            rows = np.asarray(self._normalizer.unnormalize_obs(rows))
        if self._agents > 1:
            rows = rows.reshape(len(self._pianos), -1)
        steps = self._steps(state, episode_start)
        actions = np.stack(
            [self._act(slot, int(steps[slot]), row) for slot, row in enumerate(rows)]
        ).astype(np.float32)
        if self._agents > 1:
            actions = actions.reshape(expected, -1)
        return (actions[0] if single else actions), steps + 1

    def _rows(self, observation: Any) -> tuple[Any, bool]:
        """Split observations by environment; return them and whether a single one was given."""
        if not isinstance(self._space, spaces.Dict):
            single = np.ndim(observation) == len(self._space.shape or ())
            return (np.asarray(observation)[None] if single else np.asarray(observation)), single
        name, space = next(iter(self._space.items()))
        if np.ndim(observation[name]) == len(space.shape or ()):
            return [observation], True
        count = len(observation[name])
        return [{key: of[row] for key, of in observation.items()} for row in range(count)], False

    def get_env(self) -> VecEnv:
        """Return the player's environments, a single one as a vector environment of one."""
        from stable_baselines3.common.vec_env import DummyVecEnv

        env = self._env
        return DummyVecEnv([lambda: env]) if isinstance(env, gym.Env) else env

    def get_vec_normalize_env(self) -> VecNormalize | None:
        """Return the ``VecNormalize`` of its observations, if any."""
        return self._normalizer

    def set_logger(self, logger: Logger) -> None:
        """Set the logger of the callbacks; by default they log nowhere."""
        self._logger = logger

    def set_random_seed(self, seed: int) -> None:
        """Seed the player's random generator, if it has one."""
        del seed

    def reset(self, seed: int) -> None:
        """Begin a roll-out with a seed for the random generator."""
        self.set_random_seed(seed)

    @abstractmethod
    def _act(self, slot: int, step: int, observation: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Choose the action of one environment.

        Args:
            slot: Index of the environment in ``self._pianos``.
            step: Number of finished control steps of the episode.
            observation: Observation, not normalised.
        """

    def _steps(self, state: Any, episode_start: BoolArray | None) -> IntArray:
        if state is None:
            steps = np.array([piano.steps_played for piano in self._pianos], dtype=np.intp)
        else:
            steps = np.array(state, dtype=np.intp)
        if episode_start is not None:
            steps[np.asarray(episode_start, dtype=bool)[:: self._agents]] = 0
        return steps


def singles_of(env: gym.Env[Any, Any] | VecEnv) -> list[gym.Env[Any, Any]]:
    """Return the environments in a vector environment, with their wrappers, or the only one.

    Raises:
        ConfigError: If they are in other processes.
    """
    if isinstance(env, gym.Env):
        return [env]
    from stable_baselines3.common.vec_env import DummyVecEnv

    inner = env.unwrapped
    if not isinstance(inner, DummyVecEnv):
        raise ConfigError(
            f"The environments of a {type(inner).__name__} are in other processes: expected "
            "DummyVecEnv or sb3_piano.vec_env.ThreadVecEnv."
        )
    return inner.envs


def agents_of(env: gym.Env[Any, Any] | VecEnv) -> int:
    """Return how many agents play in each environment: its hands, where each is one, else 1.

    Their rows in observations and actions of a vector are neighbours.
    """
    return 1 if isinstance(env, gym.Env) else env.num_envs // env.unwrapped.num_envs


def pianos_of(env: gym.Env[Any, Any] | VecEnv) -> list[PianoEnv]:
    """Return the piano environments inside all wrappers.

    Raises:
        ConfigError: If they are no pianos, or in other processes.
    """
    inside: list[Any] = [single.unwrapped for single in singles_of(env)]
    for piano in inside:
        if not isinstance(piano, PianoEnv):
            raise ConfigError(f"A {type(piano).__name__} cannot be played: expected a piano.")
        if not piano.scene.sides:
            raise ConfigError("A piano without hands has nobody to play it: expected hands.")
    return inside


def _normalizer_of(env: gym.Env[Any, Any] | VecEnv) -> VecNormalize | None:
    """Find the ``VecNormalize`` of observations, unless an outer wrapper changes them again."""
    if isinstance(env, gym.Env):
        return None
    from stable_baselines3.common.vec_env import unwrap_vec_normalize

    normalizer = unwrap_vec_normalize(env)
    if normalizer is None or normalizer.observation_space != env.observation_space:
        return None
    return normalizer
