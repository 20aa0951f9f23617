"""Exploration by a search among the policy's possible actions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import gymnasium as gym
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_piano.exceptions import ConfigError
from sb3_piano.players.policy import agents_of, pianos_of
from sb3_piano.players.tree_search import PianoWorld, check_goes_back, moment_of, single_envs
from sb3_piano.policies.values import PolicyValues, critic_values
from sb3_piano.settings import Count, NotNegative, Positive, checked

Score = Literal["critics", "simulation", "both"]
Choice = Literal["softmax", "greedy"]


class ActionSearchCallback(BaseCallback):
    """Explore with the best of several sampled actions instead of a single sample.

    In each control step of the training, the policy's own action competes with others, drawn from
    its distribution with ``spread`` times its standard deviation. Each action gets a score:

    * "critics": the mean of the critics' values, plus ``optimism`` times their standard deviation;
    * "simulation": the reward of the action, tried in a copy of the environment, plus the
      discounted mean of the critics' values of the policy's action after it;
    * "both": the latter, plus ``optimism`` times the standard deviation of the critics' values.

    The action with the highest score is played ("greedy"), or one drawn with a probability in
    proportion to exp(score / ``temperature``) ("softmax"). Updates and deterministic actions stay
    as without the callback. In YAML::

        callback:
          - sb3_piano.callbacks.ActionSearchCallback: {score: critics, candidates: 33}

    A candidate costs next to nothing with "critics", and a simulated control step otherwise. Where
    hands are agents, the critics choose for each hand, the simulation for both together.

    Source: "Curriculum Strategies for Bimanual Dexterous Piano Playing in RoboPianist", section
    4.3, the one-step layer: 33 candidates without the simulation and about nine with it. Its onset
    F1 after 100,000 steps is 0.92, without the layer 0.91; greedy choice is worse. The values of
    ``optimism``, ``temperature`` and ``spread`` are not told there.

    Args:
        candidates: Number of competing actions, the policy's own included; at least 1.
        score: See above.
        choice: See above.
        optimism: See above; 0 or more.
        temperature: See above, above 0; by default the entropy coefficient of the algorithm, which
            changes as it learns.
        spread: See above; 0 or more.

    Raises:
        ConfigError: If an argument is wrong; when training starts, if the algorithm is none of SAC,
            TQC and CrossQ, the observations are dictionaries, or the environment cannot be copied
            or go back.
    """

    def __init__(
        self,
        candidates: int = 33,
        score: Score = "critics",
        choice: Choice = "softmax",
        optimism: float = 1.0,
        temperature: float | None = None,
        spread: float = 2.0,
    ) -> None:
        super().__init__()
        self._candidates: int = checked("candidates", candidates, Count)
        self._score: Score = checked("score", score, Score)
        self._choice: Choice = checked("choice", choice, Choice)
        self._optimism: float = checked("optimism", optimism, NotNegative)
        self._temperature: float | None = checked("temperature", temperature, Positive | None)
        self._spread: float = checked("spread", spread, NotNegative)
        self._envs: Sequence[Any] = ()
        self._worlds: list[PianoWorld | None] = []
        self._searched_for: Any = None
        self._in_rollout = False

    def _init_callback(self) -> None:
        policy: Any = self.model.policy
        actor = getattr(policy, "actor", None)
        if not isinstance(self.model, OffPolicyAlgorithm) or not hasattr(
            actor, "get_action_dist_params"
        ):
            raise ConfigError(
                f"{type(self.model).__name__} has no critics and no distribution of actions for "
                "ActionSearchCallback: expected SAC, TQC or CrossQ."
            )
        if isinstance(self.model.observation_space, gym.spaces.Dict):
            raise ConfigError(
                f"ActionSearchCallback cannot search by {self.model.observation_space}: expected "
                "a space of plain arrays, such as that of a piano without Pixels."
            )
        if getattr(actor, "use_sde", False):
            raise ConfigError(
                "use_sde is True: expected False, as ActionSearchCallback explores in its place."
            )
        self._agents = agents_of(self.training_env)
        if self._score != "critics":
            pianos_of(self.training_env)  # raises if they are out of reach
            self._envs = single_envs(self.training_env)
            for env in self._envs:
                check_goes_back(env)
            self._worlds = [None] * len(self._envs)
            normalizer = self.model.get_vec_normalize_env()
            self._values = PolicyValues(self.model, normalizer, agents=self._agents)
        self._searched_for, self._in_rollout = None, False
        # SB3 draws the actions of a roll-out by this method of the policy, an update by the actor.
        # A training that was interrupted has left ours there.
        policy.__dict__.pop("_predict", None)
        self._own_predict = policy._predict
        policy._predict = self._predict

    def _on_training_end(self) -> None:
        policy: Any = self.model.policy
        policy.__dict__.pop("_predict", None)
        self._worlds = [None] * len(self._envs)

    def _on_rollout_start(self) -> None:
        self._in_rollout = True

    def _on_rollout_end(self) -> None:
        self._in_rollout = False

    def _on_step(self) -> bool:
        self._searched_for = self.model._last_obs
        return True

    def _is_rollout(self, observation: torch.Tensor) -> bool:
        """Return whether the training asks for an action, not an evaluation inside it.

        It is the first one for what the training's environments show.
        """
        seen: Any = self.model._last_obs
        if not self._in_rollout or seen is self._searched_for:
            return False
        expected: Any = self.model.policy.obs_to_tensor(seen)[0]
        if not torch.equal(expected, observation):
            return False
        self._searched_for = seen
        return True

    def _predict(self, observation: Any, deterministic: bool = False) -> torch.Tensor:
        """Predict as the policy does; while exploring, take the best of several actions."""
        played: torch.Tensor = self._own_predict(observation, deterministic)
        if deterministic or not self._is_rollout(observation):
            return played
        of_each = observation.split(self._agents)
        return torch.cat([self._searched(slot, rows) for slot, rows in enumerate(of_each)])

    def _searched(self, slot: int, observation: torch.Tensor) -> torch.Tensor:
        """Return the best action, (agents, n), of one environment's agents.

        Critics judge each agent's candidates; the simulation those of all agents together.
        """
        policy: Any = self.model.policy
        mean, log_std, _ = policy.actor.get_action_dist_params(observation)
        noise = torch.randn(self._candidates, *mean.shape, device=mean.device)
        noise[0] = 0.0  # the policy's own
        actions = torch.tanh(mean + self._spread * log_std.exp() * noise)
        seen = observation.expand(self._candidates, *observation.shape).flatten(0, 1)
        values = critic_values(policy, seen, actions.flatten(0, 1))
        values = values.unflatten(0, actions.shape[:2])  # (candidates, agents, critics)
        spread = self._optimism * values.std(dim=2, correction=0)
        score = values.mean(dim=2) + spread
        if self._score != "critics":
            score = self._tried(slot, actions)[:, None]
        if self._score == "both":
            score = score + spread.mean(dim=1, keepdim=True)
        if self._choice == "greedy":
            chosen = score.argmax(dim=0)
        else:
            shares = torch.softmax(score / self._heat(), dim=0)
            chosen = torch.multinomial(shares.T, 1)[:, 0]
        return actions[chosen, torch.arange(len(mean), device=mean.device)]

    def _tried(self, slot: int, actions: torch.Tensor) -> torch.Tensor:
        """Return the reward of each action plus the expected return after it."""
        env = self._envs[slot]
        piano, world = env.unwrapped, self._worlds[slot]
        if piano.steps_played == 0 or world is None or world.roll is not piano.roll:
            self._worlds[slot] = world = PianoWorld(env, self._values)
        moment, scores = moment_of(env), []
        for action in self._values.unscale_actions(actions.flatten(0, 1)):
            step = world.step(moment, action)
            ahead = 0.0 if step.terminal else world.judge(step.observation)[0]
            scores.append(step.reward + world.gamma * ahead)
        return torch.tensor(scores, device=actions.device)

    def _heat(self) -> float:
        if self._temperature is not None:
            return self._temperature
        model: Any = self.model
        log = getattr(model, "log_ent_coef", None)
        return float(model.ent_coef_tensor if log is None else log.detach().exp())
