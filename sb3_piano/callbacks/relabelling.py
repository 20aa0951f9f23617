"""Replay of episodes under the score of what they played."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import gymnasium as gym
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, unwrap_vec_wrapper

from sb3_piano.callbacks.own_env import env_name
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RunError, ScoreError
from sb3_piano.layers import layers
from sb3_piano.metrics import frame_f1
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.performance import Performance
from sb3_piano.players.policy import agents_of
from sb3_piano.vec_env import HandsAsAgents
from sb3_piano.wrappers import HindsightFlag
from sb3_piano.wrappers.hand_reward import HAND_REWARDS
from sb3_piano.wrappers.residual import Residual
from sb3_piano.wrappers.score_wrapper import FixedScore


@dataclass
class Episode:
    """Actions of an episode, as played and as stored: (agents, n) in each control step."""

    actions: list[Any] = field(default_factory=list)
    """Actions of the environment's agents in each control step."""
    stored_actions: list[Any] = field(default_factory=list)
    """The same as stored in the replay buffer."""
    steps_before: int = 0
    """Control steps before the episode, which schedules depend on."""


class Transition(NamedTuple):
    """One environment's part of a row of a replay buffer: an item for each of its agents."""

    observation: Any
    next_observation: Any
    action: Any
    reward: Any
    done: bool
    info: dict[str, Any]


class Relabelled(NamedTuple):
    """A relabelled episode."""

    transitions: list[Transition]
    sounding: float
    """Share of the control steps with a sounding key."""


class Stage:
    """An environment that replays actions."""

    def __init__(self, venv: VecEnv, model: BaseAlgorithm) -> None:
        """Prepare an environment.

        Raises:
            ConfigError: If episodes of a model's environment cannot be relabelled in it.
        """
        self._env: gym.Env[Any, Any] = getattr(venv.unwrapped, "envs")[0]  # noqa: B009
        self._agents = agents_of(venv)
        self._piano = _piano_for(self._env, venv, model)
        config = self._piano.config
        for layer in layers(self._env):
            if isinstance(layer, HindsightFlag):
                layer.relabelled = True
        self._env.reset()  # while fingers are found as in the training
        notes = self._piano.score.notes
        # A note that can be shown, whichever observation and wrappers there are.
        self._note = next((note for note in notes if note.finger != UNKNOWN_FINGER), notes[0])
        keeps_labels = config.fingering != "optimal-transport"
        # Nothing may change the score of what was played, or end the episode before it does.
        self._piano.config = dataclasses.replace(
            config,
            trim_silence=False,
            initial_buffer_time=0.0,
            hands="both",
            fingering="keep" if keeps_labels else "optimal-transport",
            goal_time="beginning",  # what was played is asked for in the step in which it was
            wrong_press_termination=False,
        )

    def relabelled(self, episode: Episode) -> Relabelled | None:
        """Return the episode relabelled, or ``None`` if its notes form no valid score.

        Raises:
            RunError: If the same actions play something else the second time.
        """
        score = self._heard(episode).to_score(by_steps=True)
        if score is None:
            return None
        score = dataclasses.replace(score, title="relabelled")
        try:
            observation, _ = self._env.reset(options={"transform": FixedScore(score=score)})
        except ScoreError:
            return None
        observation = self._by_agent(observation)
        self._piano.total_steps = episode.steps_before
        # A score ends with its last note: silence that follows is no part of it.
        steps = min(len(episode.actions), len(self._piano.roll))
        transitions = []
        played = zip(
            episode.stored_actions[:steps], self._steps(episode.actions[:steps]), strict=True
        )
        for stored, (following, rewards, info) in played:
            transitions.append(Transition(observation, following, stored, rewards, False, info))
            observation = following
        info = {**transitions[-1].info, "TimeLimit.truncated": True}
        transitions[-1] = transitions[-1]._replace(done=True, info=info)
        performance = self._piano.performance
        _check_f1(self._piano.asked_roll, performance)
        return Relabelled(transitions, float(performance.key_active.any(axis=1).mean()))

    def _heard(self, episode: Episode) -> Performance:
        """Replay an episode's actions; return the resulting performance."""
        duration = len(episode.actions) * self._piano.config.control_timestep
        note = dataclasses.replace(self._note, onset=0.0, offset=duration)
        self._env.reset(options={"transform": FixedScore(score=Score(notes=[note]))})
        for _ in self._steps(episode.actions):
            pass
        return self._piano.performance

    def _by_agent(self, observation: Any) -> Any:
        """Return the part of each agent."""
        return observation[None] if self._agents == 1 else observation.reshape(self._agents, -1)

    def _steps(self, actions: Sequence[Any]) -> Iterator[tuple[Any, Any, dict[str, Any]]]:
        """Play actions and yield the agents' observations and rewards, and info of each step."""
        for step, action in enumerate(actions, start=1):
            played = action[0] if self._agents == 1 else action.reshape(-1)
            observation, reward, terminated, truncated, info = self._env.step(played)
            rewards = [float(reward)] if self._agents == 1 else info[HAND_REWARDS]
            yield self._by_agent(observation), rewards, info
            if (terminated or truncated) and step < len(actions):
                raise RunError(
                    f"An episode of {len(actions)} control steps ended after {step} when it was "
                    "played again for HindsightCallback: expected one that ends with its piece. "
                    "Train without wrappers that end it by what is played, or without the callback."
                )


def _piano_for(env: gym.Env[Any, Any], venv: VecEnv, model: BaseAlgorithm) -> PianoEnv:
    """Return the piano of an environment; refuse one that cannot replay episodes.

    Raises:
        ConfigError: If it cannot.
    """
    piano = env.unwrapped
    if not isinstance(piano, PianoEnv):
        raise ConfigError(
            f"HindsightCallback finds {env_name(venv)}: expected a piano environment."
        )
    seen = unwrap_vec_wrapper(venv, HandsAsAgents) or env
    for name in ("observation_space", "action_space"):
        own, expected = getattr(seen, name), getattr(model, name)
        if own != expected:
            raise ConfigError(
                f"HindsightCallback cannot add transitions of one environment: its {name} is "
                f"{own}, the model's {expected}. Expected a training without vec_env_wrapper that "
                "changes it, except HandsAsAgents."
            )
    if piano.config.randomize_hand_positions:
        raise ConfigError(
            "randomize_hand_positions is True, with which HindsightCallback cannot play an episode "
            "again: expected False."
        )
    for layer in layers(env):
        if isinstance(layer, Residual):
            raise ConfigError(
                f"HindsightCallback finds {type(layer).__name__}, under which the same actions "
                "play something else when the score is another: expected a training without it."
            )
    return piano


def _check_f1(asked: PianoRoll, performance: Performance) -> None:
    f1 = frame_f1(asked.active[: len(performance)], performance.key_active)
    if f1 != 1.0:
        raise RunError(
            f"A relabelled episode has F1 {f1:.4f}: expected 1. The environment plays the same "
            "actions differently the second time, or under another score, as with a wrapper that "
            "draws something or acts by the score itself. Train without it, or without "
            "HindsightCallback."
        )
