"""Prioritized level replay: pieces with more left to learn are played more often."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from sb3_piano.arrays import FloatArray
from sb3_piano.callbacks.level_sampler import LevelSampler
from sb3_piano.callbacks.piece_choice import PieceChoice
from sb3_piano.exceptions import ConfigError
from sb3_piano.policies.values import critic_values
from sb3_piano.settings import Share, checked

Values = Callable[[Any], FloatArray]
"""Value function: stacked observations (n, ...) to V (n,)."""
LevelScore: TypeAlias = Literal["advantage", "unexplained", "progress"]
"""What a piece is rated by."""


class LevelReplayCallback(BaseCallback):
    """Play pieces with high scores, and pieces not played for long, more often.

    It sets the probabilities of each :class:`~sb3_piano.wrappers.RandomPiece` by
    :class:`~sb3_piano.callbacks.level_sampler.LevelSampler`: each piece is played once, then pieces
    are the more likely the higher their rank by score and the longer ago their last episode. The
    score is the mean absolute advantage over the steps of a piece's last episode, the generalized
    advantage estimate with the algorithm's ``gamma``::

        delta_t = r_t + gamma V(o_t+1) - V(o_t)
        A_t = sum over l from 0 on of (gamma gae_lambda)^l delta_t+l

    That grows with what happens in a piece. ``score="unexplained"`` divides it by the mean absolute
    deviation of the episode's returns A_t + V(o_t): 0 if the critic foresees them all, 1 if it
    knows no more than their mean. ``score="progress"`` is the change of F1 since the piece's last
    episode, up or down, or since that of playing nothing.

    V is the value function of PPO, A2C and TRPO. For SAC, TD3, DDPG, TQC and CrossQ it is the mean
    over the critics of Q at the policy's mode. V is 0 after a terminated episode, but not after a
    truncated one, such as the end of a piece. Observations and rewards are the algorithm's,
    normalised by the present statistics under ``VecNormalize``. Episodes are those of the training,
    with its exploration.

    All environments share the scores. An environment with a part of the pieces (``pieces`` of a run
    are dealt out) draws among its own, by the ranks among them. Unseen pieces are dealt out to the
    environments that have them; the others replay meanwhile. An environment draws the next piece in
    the step that ends an episode, so an episode counts from the second draw on. The first piece,
    also of a resumed training, follows the weights of ``RandomPiece``. Checkpoints of ``sb3-piano
    train`` save scores and visits.

    The log has ``level_replay/score`` (mean over the episodes since the last log line),
    ``level_replay/unseen`` (pieces without a score), ``level_replay/gini`` (of the visits so far: 0
    if all pieces were played equally often, towards 1 the more a few were preferred) and
    ``level_replay/top_probability`` (of the likeliest piece of any environment). In YAML::

        callback:
          - sb3_piano.callbacks.LevelReplayCallback: {beta: 0.5, rho: 0.3}

    Source: E. Farah, I. Lin and G. Walrath, "Curriculum Strategies for Bimanual Dexterous Piano
    Playing in RoboPianist", section 6.1, after Jiang et al. 2021. What V is for SAC, and
    ``gae_lambda``, are not told there.

    Args:
        beta: Temperature, above 0: the smaller, the more the highest score is preferred.
        rho: Share of the draws that go by waiting time, 0 to 1.
        gae_lambda: Decay of the advantage estimate, 0 to 1.
        score: ``"advantage"``, the paper's, ``"unexplained"`` or ``"progress"``.

    Raises:
        ConfigError: If an argument is out of range; when training starts, if no environment chooses
            among several pieces, or the algorithm has no values and the score needs them.
    """

    def __init__(
        self,
        beta: float = 0.5,
        rho: float = 0.3,
        gae_lambda: float = 0.95,
        score: LevelScore = "advantage",
    ) -> None:
        super().__init__()
        self.sampler = LevelSampler((), beta, rho)
        """Scores and visits of the pieces so far."""
        self._gae_lambda: float = checked("gae_lambda", gae_lambda, Share)
        self._score: LevelScore = checked("score", score, LevelScore)
        self._f1: dict[str, float] = {}
        self._values: Values
        self._choice: PieceChoice
        self._owners: dict[str, list[int]]
        self._playing: dict[int, str | None] = {}
        self._rollouts: dict[int, Rollout] = {}

    def state_dict(self) -> dict[str, Any]:
        """Return scores and visits, and F1 of the last episodes, in JSON's types."""
        return {**self.sampler.state_dict(), "f1": self._f1}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore scores and visits; pieces that no longer exist are left out.

        Raises:
            ConfigError: If it is no such state.
        """
        of_sampler = dict(state)
        self._f1 = dict(checked("f1", of_sampler.pop("f1", {}), Mapping[str, float]))
        self.sampler.load_state_dict(of_sampler)

    def _init_callback(self) -> None:
        if self._score != "progress":
            self._values = value_function(self.model)
        self._choice = PieceChoice(self.training_env, type(self).__name__)
        self._owners = defaultdict(list)
        for env, own in self._choice.pieces.items():
            for name in own:
                self._owners[name].append(env)

    def _on_training_start(self) -> None:
        self.sampler.set_levels(self._choice.names)
        self._playing, self._rollouts = {}, {}
        for env in self._choice.pieces:
            # A training that goes on may begin amid an episode, which was counted already.
            self._begin(env, is_new=not self._choice.has_begun(env))
        self._set_weights()

    def _on_step(self) -> bool:
        rewards, dones, infos = (self.locals[name] for name in ("rewards", "dones", "infos"))
        observations = self.model._last_obs  # SB3 replaces them after this
        for agent, rollout in self._rollouts.items():
            rollout.add(_row(observations, agent), float(rewards[agent]))
        ended = [env for env in self._choice.pieces if dones[env * self._choice.agents]]
        for env in ended:
            self._end(env, infos)
        for env in ended:
            self._begin(env)
        if ended:
            self._set_weights()
        return True

    def _agents(self, env: int) -> range:
        """Return the indices of an environment's agents in the training's vector."""
        return range(env * self._choice.agents, (env + 1) * self._choice.agents)

    def _begin(self, env: int, *, is_new: bool = True) -> None:
        """Record the piece that an environment begins."""
        self._playing[env] = name = self._choice.playing(env)
        if self._score != "progress":  # which needs no more than the end of an episode
            self._rollouts |= {agent: Rollout() for agent in self._agents(env)}
        if name is not None and is_new:
            self.sampler.visit(name)

    def _end(self, env: int, infos: Sequence[Mapping[str, Any]]) -> None:
        """Score the piece that an environment has finished."""
        name = self._playing[env]
        if name is None:
            return
        if self._score == "progress":
            score = self._progress(name, infos[env * self._choice.agents])
        else:
            surprises = [self._surprise(self._rollouts[i], infos[i]) for i in self._agents(env)]
            score = float(np.mean(surprises))  # episodes of agents are equally long
        self.sampler.rate(name, score)
        self.logger.record_mean("level_replay/score", score)

    def _progress(self, name: str, info: Mapping[str, Any]) -> float:
        """Return how much F1 has changed since a piece's last episode."""
        before = self._f1.get(name, info["noop_f1"])
        self._f1[name] = f1 = float(info["f1"])
        return abs(f1 - before)

    def _surprise(self, rollout: Rollout, info: Mapping[str, Any]) -> float:
        """Return the mean absolute advantage over an episode, given its last info.

        For the score "unexplained" it is divided by the mean deviation of the returns.
        """
        values = self._values(_stacked([*rollout.observations, info["terminal_observation"]]))
        if not info.get("TimeLimit.truncated", False):
            values[-1] = 0.0
        gamma: float = self.model.gamma  # type: ignore[attr-defined]  # all with values have it
        found = advantages(np.array(rollout.rewards), values, gamma, self._gae_lambda)
        surprise = float(np.abs(found).mean())
        if self._score == "advantage":
            return surprise
        returns = found + values[:-1]
        spread = float(np.abs(returns - returns.mean()).mean())
        return surprise / spread if spread > 0 else 0.0

    def _set_weights(self) -> None:
        """Set the probabilities of each environment's pieces, and log their state."""
        playing = {name for name in self._playing.values() if name is not None}
        dealt: dict[str, int] = {}  # to one environment each, so that no two of them draw it
        for number, name in enumerate(self.sampler.unseen(playing)):
            owners = self._owners[name]
            dealt[name] = owners[number % len(owners)]
        top = 0.0
        for env, own in self._choice.pieces.items():
            unseen = [name for name in own if dealt.get(name) == env]
            seen = [name for name in own if name not in dealt]
            likely = self.sampler.probabilities(unseen or seen or own, playing)
            self._choice.set_weights(env, likely)
            top = max(top, *likely.values())
        self.logger.record("level_replay/gini", self.sampler.gini)
        self.logger.record("level_replay/unseen", len(self.sampler.unseen()))
        self.logger.record("level_replay/top_probability", top)


@dataclass
class Rollout:
    """An agent's episode so far."""

    observations: list[Any] = field(default_factory=list)
    """Observation before each step: arrays, or mappings of them."""
    rewards: list[float] = field(default_factory=list)
    """Reward of each step."""

    def add(self, observation: Any, reward: float) -> None:
        """Add a step."""
        self.observations.append(observation)
        self.rewards.append(reward)


def advantages(
    rewards: FloatArray, values: FloatArray, gamma: float, gae_lambda: float
) -> FloatArray:
    """Return the generalized advantage estimate of each step of an episode.

    Args:
        rewards: (T,), of each step.
        values: (T + 1,), V before each step and after the last one.
        gamma: Discount of rewards, 0 to 1.
        gae_lambda: Decay of the estimate, 0 to 1.

    Returns:
        (T,) advantages.
    """
    found = rewards + gamma * values[1:] - values[:-1]
    for step in range(len(found) - 2, -1, -1):
        found[step] += gamma * gae_lambda * found[step + 1]
    return found


def value_function(model: BaseAlgorithm) -> Values:
    """Return the value function of a model; it uses the weights at the time of each call.

    Raises:
        ConfigError: If the algorithm has no values of states, nor critics of actions.
    """
    policy: Any = model.policy
    if isinstance(model, OnPolicyAlgorithm):
        return lambda observations: _numbers(policy.predict_values, policy, observations)
    if isinstance(model, OffPolicyAlgorithm) and hasattr(model, "critic"):

        def mean_value(tensors: Any) -> torch.Tensor:
            actions = policy._predict(tensors, deterministic=True)
            return critic_values(policy, tensors, actions).mean(dim=1)

        return lambda observations: _numbers(mean_value, policy, observations)
    raise ConfigError(
        f"{type(model).__name__} has no values by which LevelReplayCallback could score pieces: "
        "expected PPO, SAC, TD3 or another algorithm with values of states, or with critics."
    )


@torch.no_grad()
def _numbers(function: Callable[[Any], torch.Tensor], policy: Any, observations: Any) -> FloatArray:
    """Apply a function of tensors to observations; return (n,) numbers."""
    tensors, _ = policy.obs_to_tensor(observations)
    return function(tensors).flatten().double().cpu().numpy()


def _row(observations: Any, index: int) -> Any:
    """Return a copy of one agent's observation that keeps no reference to the others."""
    if isinstance(observations, dict):
        return {name: rows[index].copy() for name, rows in observations.items()}
    return observations[index].copy()


def _stacked(observations: Sequence[Any]) -> Any:
    """Stack observations into one array, or a mapping of arrays, one row each."""
    if isinstance(observations[0], dict):
        return {name: np.stack([one[name] for one in observations]) for name in observations[0]}
    return np.stack(observations)
