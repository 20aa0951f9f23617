"""Rollouts of excerpts: by learner and teacher in turn, or by the learner alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.demonstrations import CorrelatedNoise
from sb3_piano.demonstrations.recording import as_episode
from sb3_piano.envs import GENERAL_ID
from sb3_piano.lab.distillation.config import DistillConfig, PlayingSettings, Round
from sb3_piano.lab.distillation.teachers import Action, Teacher
from sb3_piano.music import Score
from sb3_piano.players import HandModel
from sb3_piano.players.rollout import Transition, rollout
from sb3_piano.wrappers import HandActions
from sb3_piano.wrappers.piano import unwrap_piano

if TYPE_CHECKING:
    from minari.data_collector.episode_buffer import EpisodeBuffer

_OPTIONS: dict[str, Any] = {
    "observation": "hands",
    "reduced_action_space": False,
    "initial_buffer_time": 0.5,
}
_FIRST_SCORE = "scale-CMajor"
"""Score of an environment before its first excerpt."""

_GIVEN_BACK = 0.5
"""Distance at which the teacher hands back, as a share of the takeover distance."""


def hands_env(physics: str, fingering: str = "robot") -> HandActions:
    """Return an environment in which a network for one hand can play any piece.

    Args:
        physics: Name of the physics profile.
        fingering: "keep" if all scores have fingers.
    """
    options = {"score": _FIRST_SCORE, "physics": physics, "fingering": fingering, **_OPTIONS}
    return HandActions(gym.make(GENERAL_ID, disable_env_checker=True, **options))


def play_excerpt(
    config: DistillConfig,
    round_number: int,
    number: int,
    env: HandActions,
    teacher: Teacher,
    learner: HandModel | None,
) -> tuple[EpisodeBuffer, dict[str, float]]:
    """Play an excerpt in a round, and record the teacher's action in each state.

    It is a pure function of the settings, the numbers and the learner's weights.

    Args:
        config: The settings.
        round_number: Number of the round, from 0.
        number: The excerpt's number, counted over all rounds; see :meth:`DistillConfig.of_round`.
        env: An environment of :func:`hands_env` that keeps fingers.
        teacher: A teacher in this environment.
        learner: The learner's network; ``None`` in the first round.

    Raises:
        ScoreError: If the excerpt cannot be played by the teacher.
        SimulationDivergedError: If the physics becomes unstable.
    """
    corpus, settings = config.corpus, config.rounds[round_number]
    random = np.random.default_rng((config.seed, round_number, number))
    score = corpus.fingered(number % len(corpus))
    playing = _Playing(settings, config.playing, env, random, teacher, learner)
    played: list[Transition] = []
    options = {"score": score}
    next(
        rollout(
            teacher,
            env,
            seed=number,
            options=options,
            disturb=playing.act,
            on_step=played.append,
        )
    )
    episode, notes = as_episode(played, env, number)
    shares = {"by_learner": playing.by_learner, "taken_over": playing.taken_over}
    counted = {name: count / len(episode) for name, count in shares.items()}
    return episode, {"excerpt": number, "noise": playing.noise, **counted, **notes}


def play_alone(env: HandActions, score: Score, learner: HandModel) -> Mapping[str, float]:
    """Play a piece with the learner and return the music metrics."""
    return next(rollout(learner, env, options={"score": score})).metrics


class _Playing:
    """Choice of the player and of the action noise in each step of one excerpt.

    Attributes:
        noise: Standard deviation of the noise on the teacher's actions, rad.
        by_learner: Number of steps by the learner.
        taken_over: Number of the learner's steps that the teacher took over.
    """

    def __init__(
        self,
        settings: Round,
        playing: PlayingSettings,
        env: HandActions,
        random: np.random.Generator,
        teacher: Teacher,
        learner: HandModel | None,
    ) -> None:
        self._random, self._share = random, settings.learner
        self._teacher, self._learner = teacher, learner
        timestep = unwrap_piano(env, "play_excerpt").config.control_timestep
        low, high = (max(1, round(seconds / timestep)) for seconds in playing.segment)
        self._segment = low, high  # control steps
        scale = float(random.choice(playing.noise_scales))
        self.noise = scale * settings.noise
        unit = float(np.abs(env.reach).max())  # rad of a finger's joint to an action of 1
        ones = np.ones(env.reach.shape)
        self._sample = CorrelatedNoise(ones, playing.noise_memory, timestep).sample
        self._std = (self.noise / unit, scale * settings.learner_noise / unit)
        self._step, self._until, self._learner_plays, self._lost = 0, 0, False, False
        self.by_learner = self.taken_over = 0

    def act(self, observation: npt.NDArray[np.float32], label: Action) -> Action:
        """Return the noisy action of the current player."""
        noise, action, by_learner = self._sample(self._random), label, False
        if self._learner is not None and self._is_learners(self._teacher.distance()):
            action, by_learner = self._learner.act(observation), True
        self._step += 1
        played: Action = np.clip(action + self._std[by_learner] * noise, -1, 1)
        return played.astype(np.float32)

    def _is_learners(self, distance: float) -> bool:
        """Return whether the learner plays this step, given the hands' distance from the plan."""
        if self._step == self._until:
            self._learner_plays = self._random.random() < self._share
            self._until += int(self._random.integers(*self._segment, endpoint=True))
        self._lost = distance > 1 or (self._lost and distance > _GIVEN_BACK)
        self.taken_over += self._learner_plays and self._lost
        learners = self._learner_plays and not self._lost
        self.by_learner += learners
        return bool(learners)
