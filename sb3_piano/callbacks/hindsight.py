"""Hindsight relabelling: each episode replayed under the score of what it played."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import gymnasium as gym
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import NStepReplayBuffer, ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_piano.callbacks.own_env import OwnEnvCallback, preserve_random_state
from sb3_piano.callbacks.relabelling import Episode, Stage, Transition
from sb3_piano.exceptions import ConfigError
from sb3_piano.players.policy import agents_of

_MOST_WAITING = 10_000
"""Relabelled transitions of an environment that wait for those of the others, at most so many and
an episode more: 40 MB with the full observation."""


class HindsightCallback(OwnEnvCallback):
    """Add each episode to the replay buffer a second time, relabelled in hindsight.

    At the end of an episode, its sounding keys, the nearest finger to each of them and the pedal
    become a score. The callback replays the actions under this score in its own environment, and
    adds these transitions, whose F1 is 1, after the episode's own. They end with the silence after
    the last note, or with the episode, and count as truncated. Episodes without a sound, or whose
    score the environment cannot play (a key out of its ``KeyRange``), are not added.

    The number of updates stays the same, and half of their data is relabelled. Every episode is
    simulated twice more. Several environments may differ in their pieces only, as the callback
    replays in one like the first. A row of the replay buffer has a transition of each environment,
    so relabelled ones wait for each other; those still waiting at the end of the training are lost.
    An environment with 10,000 waiting transitions relabels no more until the others have followed.

    With a :class:`~sb3_piano.wrappers.HindsightFlag` among the wrappers the agent observes the
    relabelling. The log has ``hindsight/episodes``, the number of relabelled ones so far, and
    ``hindsight/sounding``, the share of their control steps with a sounding key. In YAML::

        callback:
          - sb3_piano.callbacks.HindsightCallback

    Source: RoboVirtuoso, section 5. Its F1 after a million steps is lower with it: 0.073 on average
    of twelve pieces, 0.437 without.

    Raises:
        ConfigError: When training starts, if the algorithm has no replay buffer, or one whose
            transitions must stand in order (``n_steps``, ``optimize_memory_usage``); if the
            environment is no piano, is not seen as it is (``Dict`` observations), or plays actions
            differently each time (``randomize_hand_positions``) or under another score (corrections
            of a player); or if it cannot be copied.
        RunError: If a relabelled episode has another F1 than 1: the environment plays the same
            actions differently.
    """

    def __init__(self) -> None:
        super().__init__()
        self._stage: Stage
        self._under_way: list[Episode | None] = []
        self._ended: list[tuple[int, Episode]] = []
        self._waiting: list[deque[Transition]] = []
        self._n_episodes = 0

    def _init_callback(self) -> None:
        _check_algorithm(self.model)
        self._stage = Stage(self._make_own_env(), self.model)
        self._ended = []
        self._agents = agents_of(self.training_env)
        self._waiting = [deque() for _ in range(self.training_env.num_envs // self._agents)]

    def _on_training_start(self) -> None:
        # A training that goes on may begin amid an episode, whose first actions are not known.
        played = self.training_env.unwrapped.get_attr("steps_played")
        self._under_way = [Episode() if steps == 0 else None for steps in played]

    def _on_step(self) -> bool:
        actions, stored = self.locals["actions"], self.locals["buffer_actions"]
        for slot, episode in enumerate(self._under_way):
            agents = slice(slot * self._agents, (slot + 1) * self._agents)
            if episode is not None:
                episode.actions.append(actions[agents].copy())
                episode.stored_actions.append(stored[agents].copy())
            if self.locals["dones"][agents.start]:
                self._end(slot)
        return True

    def _end(self, slot: int) -> None:
        episode, self._under_way[slot] = self._under_way[slot], Episode()
        if episode is not None:
            (total,) = self.training_env.unwrapped.get_attr("total_steps", slot)
            episode.steps_before = total - len(episode.actions)
            self._ended.append((slot, episode))

    def _on_rollout_end(self) -> None:
        # Not before: SB3 stores a transition after the callbacks' step.
        ended, self._ended = self._ended, []
        buffer = _replay_buffer(self.model)
        most = min(_MOST_WAITING, buffer.buffer_size // 2)
        for slot, episode in ended:
            if len(self._waiting[slot]) < most:
                self._relabel(slot, episode)
        while all(self._waiting):
            row = [waiting.popleft() for waiting in self._waiting]
            _add_row(buffer, row, self._agents)

    def _relabel(self, slot: int, episode: Episode) -> None:
        with preserve_random_state(self.model, None):
            relabelled = self._stage.relabelled(episode)
        if relabelled is None:
            return
        self._waiting[slot].extend(relabelled.transitions)
        self._n_episodes += 1
        self.logger.record("hindsight/episodes", self._n_episodes)
        self.logger.record_mean("hindsight/sounding", relabelled.sounding)


def _replay_buffer(model: BaseAlgorithm) -> ReplayBuffer:
    buffer = model.replay_buffer if isinstance(model, OffPolicyAlgorithm) else None
    if buffer is None:
        raise ConfigError(
            f"{type(model).__name__} has no replay buffer for HindsightCallback: expected SAC, TD3 "
            "or another off-policy algorithm."
        )
    return buffer


def _check_algorithm(model: BaseAlgorithm) -> None:
    buffer = _replay_buffer(model)
    if isinstance(model.observation_space, gym.spaces.Dict):
        raise ConfigError(
            f"HindsightCallback cannot add observations of {model.observation_space}: expected a "
            "space of plain arrays, such as that of a piano without Pixels."
        )
    if isinstance(buffer, NStepReplayBuffer) or buffer.optimize_memory_usage:
        raise ConfigError(
            f"In a {type(buffer).__name__} each transition must follow the one before, between "
            "which HindsightCallback adds others: expected n_steps of 1 and no "
            "optimize_memory_usage."
        )


def _add_row(buffer: ReplayBuffer, row: Sequence[Transition], agents: int) -> None:
    observations, following, actions, rewards, dones, infos = zip(*row, strict=True)
    buffer.add(
        np.concatenate(observations),
        np.concatenate(following),
        np.concatenate(actions),
        np.concatenate(rewards),
        np.repeat(dones, agents),
        [info for info in infos for _ in range(agents)],
    )
