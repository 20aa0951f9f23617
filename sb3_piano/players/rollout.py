"""The loop in which players play: from one player in one environment, episode after episode."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.envs import EpisodeRecorder
from sb3_piano.layers import layers
from sb3_piano.players.policy import singles_of
from sb3_piano.settings import Count, Index, checked
from sb3_piano.threads import torch_computing
from sb3_piano.viewing.take import Take

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

Env = gym.Env[Any, Any]


class Player(Protocol):
    """Whatever plays: a model of Stable-Baselines3, a planned pianist, or anything with its method.

    Players that draw at random also have ``reset(seed)``.
    """

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return what to play next, and the state for the next call."""


class Transition(NamedTuple):
    """A control step of a roll-out."""

    observation: Any
    """What the player saw."""
    label: Any
    """The action that the player chose."""
    action: Any
    """The action that was played: the same, unless something disturbs it."""
    reward: float
    terminated: bool
    info: dict[str, Any]
    after: Any
    """What is observed after it."""


Disturb = Callable[[Any, Any], Any]
"""Returns the action that is played for an observation and the action that the player chose."""


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
    """Let a player play, without exploring; yield a take of each episode when it has ended.

    The first episode begins from the seed, and the others go on from there, as in Gymnasium. What
    is recorded is what an :class:`~sb3_piano.envs.EpisodeRecorder` among the wrappers sees; without
    one it is what the outermost wrapper earns.

    Args:
        player: Who plays.
        env: An environment, or a vector of one as of Stable-Baselines3.
        episodes: How many episodes to play; ``None`` for as many as are asked for.
        seed: Seeds the environment and what the player draws at random; ``None`` leaves both.
        options: Options of each episode's ``reset``, such as the score.
        resting: Whether the hands rest, whatever the player says.
        disturb: Changes the actions that are played.
        on_step: Is called after each control step.

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
    recorder.finished.clear()  # an episode that was left under way ends here
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
        # While the hands rest, nobody hears what is asked; to search for it would take long.
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
        else:  # a wrapper further out has ended it: its record is there when the next one begins
            observation, _ = env.reset(options=options)
            yield recorder.finished.pop()


def _recorder_in(env: Env) -> EpisodeRecorder | None:
    found = [layer for layer in layers(env) if isinstance(layer, EpisodeRecorder)]
    return found[-1] if found else None


class _FirstOfVector:
    """A vector of environments of which the first one is played, as a single environment.

    Where the hands of a piano are agents, the vector has a row for each.
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
        """Step; what the vector observes after an episode's end belongs to the next one."""
        observation, reward, done, infos = self._venv.step(action)
        over = bool(done[0])
        self._next = observation if over else None
        return observation, float(reward[0]), over, False, infos[0]
