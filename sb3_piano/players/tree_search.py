"""Tree search: the actions of a trained policy, tried in simulation before one is played."""

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
from sb3_piano.envs import EpisodeRecorder, PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.players.guides import PlayerGuide
from sb3_piano.players.policy import PianoPolicy, singles_of
from sb3_piano.players.tree import Step, Tree, TreeSettings
from sb3_piano.policies.values import PolicyValues
from sb3_piano.settings import Index, NotNegative, checked
from sb3_piano.wrappers.hand_actions import change_of_actions
from sb3_piano.wrappers.piano import piano_of

_WATCHERS = (Monitor, EpisodeRecorder)
"""Wrappers that only write down what happens."""
_WITHOUT_MEMORY = (
    gym.Wrapper.step,
    gym.ObservationWrapper.step,
    gym.ActionWrapper.step,
    gym.RewardWrapper.step,
    gym.wrappers.OrderEnforcing.step,
    gym.wrappers.PassiveEnvChecker.step,
)


class SearchStatistics(NamedTuple):
    """What trees looked like, as means over the control steps."""

    steps: int
    """Number of control steps."""
    children: float
    """Actions that were tried at the root."""
    deepest: float
    """Depth of the deepest node."""
    visit_share: float
    """Share of the simulations that went to the action with the highest value."""


class TreeSearch(PianoPolicy):
    """Play what a trained model or another player would, after looking ahead.

    In each control step a tree of actions is searched (see :class:`~sb3_piano.players.tree.Tree`):
    the policy proposes them, a copy of the environment tells what each leads to and earns, and the
    critics value where the tree ends. The action that was tried most is played. Nothing is learnt.

    A player without critics, such as the sight-reader, proposes what it would play and variations
    of it. What they earn is then told by what is heard, and by nothing beyond the tree: see
    :class:`~sb3_piano.players.guides.PlayerGuide`.

    The environment that is played in is not touched: the copy is made when an episode begins, with
    all wrappers. Wrappers that remember something between control steps must have ``snapshot`` and
    ``go_back``, as those of this package do.

    A model's rewards are those of the environment. The values of SAC's critics have its entropy in
    them. The end of a piece is worth nothing, as in the source, though the critics of
    Stable-Baselines3 look beyond it.

    With the default widening 64 simulations reach about 5 control steps ahead, whatever ``depth``
    says: ``widening=0.5`` goes deeper, with half as many actions; :attr:`statistics` tells.

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
        """Take who is to look ahead, and the environments to act in.

        Args:
            model: A trained model of SAC, TD3, DDPG, TQC or CrossQ, or a player of these
                environments; it is used, not changed.
            env: The environment, wrapped or not, or several of them in this process as a vector
                environment of Stable-Baselines3, normalised as the model was trained.
            shape: Size and shape of the trees; by default ``TreeSettings()``.
            noise: Standard deviation of what is added to an action to get others, where there is no
                distribution of them, as of TD3 and of players: rad of a finger's joint; other
                actuators as far as moves a fingertip as much.
            seed: Of these actions, 0 or more.

        Raises:
            ConfigError: If the model has no critics, the environment is out of reach, none of the
                model's, or has a wrapper that cannot go back.
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
            self._values = PolicyValues(checked_model, self._normalizer, self._noise)
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
        """Return the standard deviation of the noise, (n,), for actions of n numbers."""
        noise = np.zeros(self._envs[0].action_space.shape or ())
        try:
            change = np.abs(change_of_actions(self._envs[0], rad, "TreeSearch"))
        except ConfigError:  # actions of another kind, each of which is a share of its range
            return np.full(noise.shape, rad)
        noise[: len(change)] = change  # the pedal may follow
        return noise

    @property
    def statistics(self) -> SearchStatistics:
        """What the trees looked like so far."""
        if not self._searches:
            return SearchStatistics(0, np.nan, np.nan, np.nan)
        return SearchStatistics(len(self._searches), *map(fmean, zip(*self._searches, strict=True)))

    def set_random_seed(self, seed: int) -> None:
        """Begin anew with what is drawn at random."""
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
    """What proposes actions, and says what they are worth."""

    gamma: float
    """Discount of a control step."""

    def copied(self, memo: dict[int, Any]) -> Guide:
        """Return the guide in a copy of the environment, which is in ``memo``."""

    def reward(self, piano: PianoEnv, reward: float, info: Mapping[str, Any]) -> float:
        """Return what the last control step was worth."""

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return what is expected of the environment's present moment, and what is played."""

    def propose(self, observation: Any, mode: Float32Array) -> list[Float32Array]:
        """Return actions other than the one that is played."""


class PianoWorld:
    """A copy of an environment, in which actions are tried."""

    def __init__(self, env: gym.Env[Any, Any], guide: Guide):
        """Copy an environment amid an episode, with its guide."""
        memo: dict[int, Any] = {}
        for layer in reversed([one for one in layers(env) if isinstance(one, _WATCHERS)]):
            memo[id(layer)] = copy.deepcopy(layer.env, memo)
        self._env = copy.deepcopy(env, memo)
        self._guide = guide.copied(memo)
        self._piano: Any = self._env.unwrapped
        self.gamma = guide.gamma
        self.roll = piano_of(env, "TreeSearch").roll
        """What is played in the environment, by which its episode is known."""

    def go_back(self, moment: Any) -> None:
        """Go to a moment of the environment or of the copy."""
        for layer, state in zip(_with_memory(self._env), moment, strict=True):
            layer.go_back(state)

    def step(self, moment: Any, action: Float32Array) -> Step:
        """Try an action in a moment."""
        self.go_back(moment)
        observation, reward, terminated, truncated, info = self._env.step(action)
        worth = self._guide.reward(self._piano, float(reward), info)
        return Step(observation, worth, moment_of(self._env), terminated or truncated)

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return what is expected of the present moment, and what the guide plays."""
        return self._guide.judge(observation)

    def propose(self, observation: Any, mode: Float32Array) -> list[Float32Array]:
        """Return other actions."""
        return self._guide.propose(observation, mode)


def _checked_model(model: BaseAlgorithm, env: gym.Env[Any, Any] | VecEnv) -> OffPolicyAlgorithm:
    """Return a model that has critics and fits the environment; refuse others."""
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
    """Yield the wrappers that remember something between control steps, and the piano."""
    return (layer for layer in layers(env) if hasattr(type(layer), "snapshot"))


def moment_of(env: gym.Env[Any, Any]) -> list[Any]:
    """Return where an environment and its wrappers stand, to go back there."""
    return [layer.snapshot() for layer in _with_memory(env)]


def single_envs(env: gym.Env[Any, Any] | VecEnv) -> Sequence[gym.Env[Any, Any]]:
    """Return the environments of a vector in this process, normalised or not.

    Raises:
        ConfigError: If there is anything else around them.
    """
    wrapper: Any = env
    while isinstance(wrapper, VecEnvWrapper):
        if not isinstance(wrapper, VecNormalize | VecMonitor):
            raise ConfigError(
                f"A tree cannot be searched with {type(wrapper).__name__} around the environments: "
                "expected none, or VecNormalize."
            )
        wrapper = wrapper.venv
    return singles_of(env)


def check_goes_back(env: gym.Env[Any, Any]) -> None:
    """Refuse wrappers that may remember something between control steps but cannot go back.

    Raises:
        ConfigError: If there is one.
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
