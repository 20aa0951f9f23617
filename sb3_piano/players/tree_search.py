"""Player that improves a trained policy or another player by tree search in simulation."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean
from typing import Any, NamedTuple, Protocol

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvWrapper

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.players.guides import PlayerGuide
from sb3_piano.players.policy import PianoPolicy, singles_of
from sb3_piano.players.recorder import EpisodeRecorder
from sb3_piano.players.tree import Step, Tree, TreeSettings
from sb3_piano.policies.values import PolicyValues
from sb3_piano.settings import Index, NotNegative, checked
from sb3_piano.vec_env import HandsAsAgents
from sb3_piano.wrappers.hand_actions import change_of_actions
from sb3_piano.wrappers.piano import unwrap_piano

_WATCHERS = (Monitor, EpisodeRecorder)
"""Wrappers that only record."""
_WITHOUT_MEMORY = (
    gym.Wrapper.step,
    gym.ObservationWrapper.step,
    gym.ActionWrapper.step,
    gym.RewardWrapper.step,
    gym.wrappers.OrderEnforcing.step,
    gym.wrappers.PassiveEnvChecker.step,
)


class SearchStatistics(NamedTuple):
    """Statistics of search trees, as means over the control steps."""

    steps: int
    """Number of control steps."""
    children: float
    """Actions tried at the root."""
    deepest: float
    """Depth of the deepest node."""
    visit_share: float
    """Share of the simulations that went to the action with the highest value."""


class TreeSearch(PianoPolicy):
    """Improve the actions of a trained model or another player by lookahead.

    Each control step searches a tree of actions (see :class:`~sb3_piano.players.tree.Tree`). The
    policy proposes them, a copy of the environment simulates their results and rewards, and the
    critics value the leaves. The most visited action is played. Nothing is learnt.

    A player without critics, such as the sight-reader, proposes its own action and variations of
    it. Their rewards are then musical, and leaves have the value 0: see
    :class:`~sb3_piano.players.guides.PlayerGuide`.

    The played environment is not changed. When an episode begins, it is copied with all wrappers.
    Wrappers with a state between control steps must have ``snapshot`` and ``go_back``, as the
    wrappers of this package do.

    A model's rewards are those of the environment. Where hands are agents, a step is that of both,
    and a value is the mean of theirs. The values of SAC's critics include its entropy.
    The end of a piece has the value 0, as in the source, although the critics of Stable-Baselines3
    look beyond it.

    With the default widening 64 simulations look about 5 control steps ahead for any larger
    ``depth``. ``widening=0.5`` searches deeper, with half as many actions; see :attr:`statistics`.

    Source: "Curriculum Strategies for Bimanual Dexterous Piano Playing in RoboPianist", section 4.3
    and appendix A. There the trained piece gains nothing, and an unseen one 0.08 to 0.11 in onset
    F1 over 0.11 to 0.13.
    """

    def __init__(
        self,
        model: BaseAlgorithm | PianoPolicy,
        env: gym.Env[Any, Any] | VecEnv,
        shape: TreeSettings | None = None,
        *,
        noise: float = 0.12,
        seed: int = 0,
    ) -> None:
        """Take the model or player, and the environments to act in.

        Args:
            model: A trained model of SAC, TD3, DDPG, TQC or CrossQ, or a player of these
                environments; it is not changed.
            env: The environment, wrapped or not, or several of them in this process as a vector
                environment of Stable-Baselines3, normalised as the model was trained.
            shape: Size and shape of the trees; by default ``TreeSettings()``.
            noise: Standard deviation of the noise that gives other actions, for models without a
                distribution of actions (TD3, players): rad of a finger joint; for other actuators
                the amount that moves a fingertip as far.
            seed: Seed of these actions, 0 or more.

        Raises:
            ConfigError: If the model has no critics, or the environment is in another process, does
                not fit the model, or has a wrapper that cannot go back.
        """
        super().__init__(env)
        self._envs = single_envs(env)
        for single in self._envs:
            check_goes_back(single)
        self._shape = TreeSettings() if shape is None else shape
        self._model = model
        self.num_timesteps = model.num_timesteps
        self.device = model.device
        self._noise = self._noise_of_actions(checked("noise", noise, NotNegative))
        self._random = np.random.default_rng()
        if isinstance(model, PianoPolicy):
            self._check_player(model)
        else:
            checked_model = _checked_model(model, env)
            self._values = PolicyValues(
                checked_model, self._normalizer, self._noise, agents=self._agents
            )
        self.set_random_seed(seed)
        self._worlds: list[PianoWorld | None] = [None] * len(self._envs)
        self._searches: list[tuple[int, int, float]] = []

    def _check_player(self, player: PianoPolicy) -> None:
        if [*map(id, player._pianos)] != [*map(id, self._pianos)]:
            raise ConfigError(
                f"The {type(player).__name__} plays in other environments: expected one that was "
                "made for these."
            )

    def _noise_of_actions(self, rad: float) -> FloatArray:
        """Compute the standard deviation of the noise, (n,), for actions of n numbers."""
        noise = np.zeros(self._envs[0].action_space.shape or ())
        try:
            change = np.abs(change_of_actions(self._envs[0], rad, "TreeSearch"))
        except ConfigError:  # other actions: shares of their ranges
            return np.full(noise.shape, rad)
        noise[: len(change)] = change  # the pedal may follow
        return noise

    @property
    def statistics(self) -> SearchStatistics:
        """Statistics of the trees so far."""
        if not self._searches:
            return SearchStatistics(0, np.nan, np.nan, np.nan)
        return SearchStatistics(len(self._searches), *map(fmean, zip(*self._searches, strict=True)))

    def set_random_seed(self, seed: int) -> None:
        """Seed the random generator of the search."""
        self._random = np.random.default_rng(checked("seed", seed, Index))
        if not isinstance(self._model, PianoPolicy):
            self._values.set_random_seed(seed)

    def _act(self, slot: int, step: int, observation: npt.NDArray[Any]) -> npt.NDArray[Any]:
        env, world = self._envs[slot], self._worlds[slot]
        if step == 0 or world is None or world.roll is not self._pianos[slot].roll:
            self._worlds[slot] = world = PianoWorld(env, self._guide(slot))
        found = Tree(world, self._shape).search(observation, moment_of(env))
        self._searches.append((len(found.root.edges), found.deepest, found.visit_share))
        return found.action

    def _guide(self, slot: int) -> Guide:
        if isinstance(self._model, PianoPolicy):
            return PlayerGuide(self._model, slot, self._noise, self._random)
        return self._values


class Guide(Protocol):
    """Protocol of guides of the search: they propose actions and value states."""

    gamma: float
    """Discount of a control step."""

    def copied(self, memo: dict[int, Any]) -> Guide:
        """Copy the guide for a copy of the environment, which is in ``memo``."""

    def reward(self, piano: PianoEnv, reward: float, info: Mapping[str, Any]) -> float:
        """Return the reward of the last control step."""

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return the value of the environment's present state, and the action there."""

    def propose(self, observation: Any, mode: Float32Array) -> list[Float32Array]:
        """Propose actions other than the guide's own."""


class PianoWorld:
    """Copy of an environment, in which actions are tried."""

    def __init__(self, env: gym.Env[Any, Any], guide: Guide):
        """Copy an environment during an episode, with its guide."""
        memo: dict[int, Any] = {}
        for layer in reversed([one for one in layers(env) if isinstance(one, _WATCHERS)]):
            memo[id(layer)] = copy.deepcopy(layer.env, memo)
        self._env = copy.deepcopy(env, memo)
        self._guide = guide.copied(memo)
        self._piano: Any = self._env.unwrapped
        self.gamma = guide.gamma
        self.roll = unwrap_piano(env, "TreeSearch").roll
        """The episode's piano roll, which identifies the episode."""

    def go_back(self, moment: Any) -> None:
        """Restore a state of the environment or of the copy."""
        for layer, state in zip(_with_memory(self._env), moment, strict=True):
            layer.go_back(state)

    def step(self, moment: Any, action: Float32Array) -> Step:
        """Try an action in a state."""
        self.go_back(moment)
        observation, reward, terminated, truncated, info = self._env.step(action)
        worth = self._guide.reward(self._piano, float(reward), info)
        return Step(observation, worth, moment_of(self._env), terminated or truncated)

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return the value of the present state, and the guide's action."""
        return self._guide.judge(observation)

    def propose(self, observation: Any, mode: Float32Array) -> list[Float32Array]:
        """Propose other actions."""
        return self._guide.propose(observation, mode)


def _checked_model(model: BaseAlgorithm, env: gym.Env[Any, Any] | VecEnv) -> OffPolicyAlgorithm:
    """Check that a model has critics and fits the environment."""
    if not isinstance(model, OffPolicyAlgorithm) or not hasattr(model.policy, "critic"):
        raise ConfigError(
            f"A tree cannot be searched with {type(model).__name__}, which has no critics: "
            "expected a model of SAC, TD3, DDPG, TQC or CrossQ."
        )
    for name in ("observation_space", "action_space"):
        ours, theirs = getattr(env, name), getattr(model, name)
        if ours != theirs:
            raise ConfigError(
                f"The environment's {name} is {ours}, the model's {theirs}: expected the "
                "wrappers with which it was trained."
            )
    return model


def _with_memory(env: gym.Env[Any, Any]) -> Iterator[Any]:
    """Yield the wrappers with a state between control steps, and the piano."""
    return (layer for layer in layers(env) if hasattr(type(layer), "snapshot"))


def moment_of(env: gym.Env[Any, Any]) -> list[Any]:
    """Save the states of an environment and its wrappers."""
    return [layer.snapshot() for layer in _with_memory(env)]


def single_envs(env: gym.Env[Any, Any] | VecEnv) -> Sequence[gym.Env[Any, Any]]:
    """Return the environments of a vector in this process, normalised or not.

    Raises:
        ConfigError: If another vector wrapper is around them, or hands are agents of what is
            normalised.
    """
    wrapper: Any = env
    known: tuple[type, ...] = (VecNormalize, VecMonitor, HandsAsAgents)
    while isinstance(wrapper, VecEnvWrapper):
        if not isinstance(wrapper, known):
            raise ConfigError(
                f"A tree cannot be searched with {type(wrapper).__name__} around the environments: "
                "expected none, HandsAsAgents, or VecNormalize around all others."
            )
        if isinstance(wrapper, HandsAsAgents):
            known = (VecMonitor,)
        wrapper = wrapper.venv
    return singles_of(env)


def check_goes_back(env: gym.Env[Any, Any]) -> None:
    """Check that wrappers with a possible state between control steps can restore it.

    Raises:
        ConfigError: If one cannot.
    """
    for layer in layers(env):
        kind = type(layer)
        known = isinstance(layer, _WATCHERS) or kind.__module__.startswith("sb3_piano.")
        if not known and not hasattr(kind, "snapshot") and kind.step not in _WITHOUT_MEMORY:
            raise ConfigError(
                f"A tree cannot be searched with the wrapper {kind.__name__}, which may remember "
                "something between control steps: expected it to have snapshot() and go_back(), "
                "as sb3_piano.wrappers.HandReward has."
            )
