"""Tree search: the actions of a trained policy, tried in simulation before one is played."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from statistics import fmean
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvWrapper

from sb3_piano.arrays import Float32Array
from sb3_piano.envs import EpisodeRecorder
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.music import PianoRoll
from sb3_piano.planning import PianoPolicy
from sb3_piano.players.tree import Step, Tree, TreeSettings
from sb3_piano.policies.values import PolicyValues
from sb3_piano.settings import Index, NotNegative, checked

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
    """Play what a model of SAC, TD3, DDPG, TQC or CrossQ would, after looking ahead.

    In each control step a tree of actions is searched (see :class:`~sb3_piano.players.tree.Tree`):
    the policy proposes them, a copy of the environment tells what each leads to and earns, and the
    critics value where the tree ends. The action that was tried most is played. Nothing is learnt.

    The environment that is played in is not touched: the copy is made when an episode begins, with
    all wrappers. Wrappers that remember something between control steps must have ``snapshot`` and
    ``go_back``, as those of this package do.

    Rewards are the environment's, also where they are not the model's, and undiscounted values of
    entropy are in the critics of SAC as it has learnt them. The end of a piece is worth nothing, as
    in the source, though the critics of Stable-Baselines3 look beyond it. Wherever all nodes end at
    the same depth, this changes no choice.

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
        noise: float = 0.1,
        seed: int = 0,
    ) -> None:
        """Take the model, and the environments to act in.

        Args:
            model: The trained model; it is used, not changed.
            env: The environment, wrapped or not, or several of them in this process as a vector
                environment of Stable-Baselines3, normalised as the model was trained.
            shape: Size and shape of the trees; by default ``TreeSettings()``.
            noise: Standard deviation of what is added to a policy that has no distribution of its
                own, as that of TD3, to get other actions than the one it plays.
            seed: Of these actions, 0 or more.

        Raises:
            ConfigError: If the model has no critics, the environment is out of reach, none of the
                model's, or has a wrapper that cannot go back.
        """
        super().__init__(env)
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
        self.num_timesteps = model.num_timesteps
        self.device = model.device
        self._envs = single_envs(env)
        for single in self._envs:
            check_goes_back(single)
        self._shape = TreeSettings() if shape is None else shape
        self._judge = PolicyValues(model, self._normalizer, checked("noise", noise, NotNegative))
        self.set_random_seed(seed)
        self._worlds: list[PianoWorld | None] = [None] * len(self._envs)
        self._searches: list[tuple[int, int, float]] = []

    @property
    def statistics(self) -> SearchStatistics:
        """What the trees looked like so far."""
        if not self._searches:
            return SearchStatistics(0, np.nan, np.nan, np.nan)
        return SearchStatistics(len(self._searches), *map(fmean, zip(*self._searches, strict=True)))

    def set_random_seed(self, seed: int) -> None:
        """Begin anew with what is drawn at random."""
        self._judge.set_random_seed(checked("seed", seed, Index))

    def _act(self, slot: int, step: int, observation: npt.NDArray[Any]) -> npt.NDArray[Any]:
        env, world = self._envs[slot], self._worlds[slot]
        if step == 0 or world is None or world.roll is not self._pianos[slot].roll:
            self._worlds[slot] = world = PianoWorld(env, self._pianos[slot].roll, self._judge)
        found = Tree(world, self._shape).search(observation, moment_of(env))
        self._searches.append((len(found.root.edges), found.deepest, found.visit_share))
        return found.action


class PianoWorld:
    """A copy of an environment, in which actions are tried."""

    def __init__(self, env: gym.Env[Any, Any], roll: PianoRoll, judge: PolicyValues):
        self._env = _copy_without_watchers(env)
        self._judge = judge
        self.gamma = judge.gamma
        self.roll = roll
        """What is played in the environment, by which its episode is known."""

    def step(self, moment: Any, action: Float32Array) -> Step:
        """Try an action in a moment."""
        for layer, state in zip(_with_memory(self._env), moment, strict=True):
            layer.go_back(state)
        observation, reward, terminated, truncated, _ = self._env.step(action)
        ended = terminated or truncated
        return Step(observation, self._judge.reward(float(reward)), moment_of(self._env), ended)

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return what the critics expect of the policy's own action, and this."""
        return self._judge.judge(observation)

    def propose(self, observation: Any) -> list[Float32Array]:
        """Return other actions of the policy."""
        return self._judge.propose(observation)


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
    if not isinstance(env, VecEnv):
        return [env]
    wrapper: VecEnv = env
    while isinstance(wrapper, VecEnvWrapper):
        if not isinstance(wrapper, VecNormalize | VecMonitor):
            raise ConfigError(
                f"A tree cannot be searched with {type(wrapper).__name__} around the environments: "
                "expected none, or VecNormalize."
            )
        wrapper = wrapper.venv
    assert isinstance(wrapper, DummyVecEnv), "PianoPolicy refuses others"
    return wrapper.envs


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
                "as sb3_piano.wrappers.PreviousActionReward has."
            )


def _copy_without_watchers(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    memo: dict[int, Any] = {}
    for layer in reversed([one for one in layers(env) if isinstance(one, _WATCHERS)]):
        memo[id(layer)] = copy.deepcopy(layer.env, memo)
    return copy.deepcopy(env, memo)
