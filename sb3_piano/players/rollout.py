"""Roll-outs of one player in one environment, episode after episode."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.layers import layers
from sb3_piano.players.policy import singles_of
from sb3_piano.players.recorder import EpisodeRecorder
from sb3_piano.settings import Count, Index, checked
from sb3_piano.take import Take
from sb3_piano.threads import torch_computing

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

Env = gym.Env[Any, Any]


class Player(Protocol):
    """Protocol of players: models of Stable-Baselines3, the players of this package, and others.

    Players with a random generator also have ``reset(seed)``.
    """

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return the next action and the state for the next call."""


class Transition(NamedTuple):
    """A control step of a roll-out."""

    observation: Any
    """Observation of the player."""
    label: Any
    """Action that the player chose."""
    action: Any
    """Action that was played: the same unless disturbed."""
    reward: float
    terminated: bool
    info: dict[str, Any]
    after: Any
    """Observation after the step."""


Disturb = Callable[[Any, Any], Any]
"""Function of the observation and the player's action that returns the action to play."""


def rollout(
    player: Player,
    env: Env | VecEnv,
    *,
    episodes: int | None = 1,
    seed: int | None = 0,
    options: dict[str, Any] | None = None,
    resting: bool = False,
    disturb: Disturb | None = None,
    on_step: Callable[[Transition], object] = lambda transition: None,
) -> Iterator[Take]:
    """Play episodes with the deterministic policy; yield a take of each when it has ended.

    The seed applies to the first episode, and the others continue its random sequence, as in
    Gymnasium. An :class:`~sb3_piano.players.EpisodeRecorder` among the wrappers decides which
    rewards are recorded; without one, those of the outermost wrapper are.

    Args:
        player: The player.
        env: An environment, or a Stable-Baselines3 vector environment of one.
        episodes: Number of episodes; ``None`` for no limit.
        seed: Seed of the environment and of the player; ``None`` leaves both as they are.
        options: Options of each episode's ``reset``, such as the score.
        resting: Whether the hands rest and the player's actions are ignored.
        disturb: Function that changes the actions to play.
        on_step: Function called after each control step.

    Raises:
        ConfigError: If a number is out of range.
    """
    count = checked("episodes", episodes, Count | None)
    seed = checked("seed", seed, Index | None)
    if isinstance(env, gym.Env) and _recorder_in(env) is None:
        env = EpisodeRecorder(env)
    stage: Any = env if isinstance(env, gym.Env) else _FirstOfVector(env)
    first: Any = env if isinstance(env, gym.Env) else singles_of(env)[0]
    recorder = _recorder_in(first)
    assert recorder is not None, "a vector has been made with one"
    if seed is not None and hasattr(player, "reset"):
        player.reset(seed)
    recorder.resting = resting
    observation, _ = stage.reset(seed=seed, options=options)
    recorder.finished.clear()  # an unfinished episode ended with this reset
    played = _episodes(player, stage, recorder, observation, options, disturb, on_step)
    return itertools.islice(played, count)


def _episodes(
    player: Player,
    env: Any,
    recorder: EpisodeRecorder,
    observation: Any,
    options: dict[str, Any] | None,
    disturb: Disturb | None,
    on_step: Callable[[Transition], object],
) -> Iterator[Take]:
    state, over = None, True
    label = None
    while True:
        start = np.full(getattr(env, "num_envs", 1), over)
        # Actions are ignored while the hands rest, and some players need long to compute one.
        if label is None or not recorder.resting:
            with torch_computing():
                label, state = player.predict(observation, state, start, deterministic=True)
        action = label if disturb is None else disturb(observation, label)
        before = np.array(observation) if isinstance(observation, np.ndarray) else observation
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        on_step(Transition(before, label, action, float(reward), terminated, info, observation))
        if not over:
            continue
        if recorder.finished:
            yield recorder.finished.pop()
            observation, _ = env.reset(options=options)
        else:  # an outer wrapper has ended it: it is recorded when the next one begins
            observation, _ = env.reset(options=options)
            yield recorder.finished.pop()


def _recorder_in(env: Env) -> EpisodeRecorder | None:
    found = [layer for layer in layers(env) if isinstance(layer, EpisodeRecorder)]
    return found[-1] if found else None


class _FirstOfVector:
    """Adapter of a vector environment's first environment to a single environment.

    If the hands of a piano are agents, the vector has a row for each hand.
    """

    def __init__(self, venv: VecEnv) -> None:
        self._venv = venv
        self.num_envs = venv.num_envs
        self._next: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode, unless the vector has begun it already."""
        if self._next is not None:
            observation, self._next = self._next, None
            return observation, {}
        if seed is not None:
            self._venv.seed(seed)
        self._venv.set_options(options)
        return self._venv.reset(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step. After an episode's end, the vector's observation belongs to the next episode."""
        observation, reward, done, infos = self._venv.step(action)
        over = bool(done[0])
        self._next = observation if over else None
        return observation, float(reward[0]), over, False, infos[0]
