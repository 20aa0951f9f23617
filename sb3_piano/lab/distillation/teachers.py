"""Teachers: who says what would be right in each state."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.distillation.config import PLANNED, PlayingSettings, TeacherSettings
from sb3_piano.planning import PlanSettings, Tracker, plan
from sb3_piano.players.rollout import Player
from sb3_piano.training.playing.player import OpenPlayer
from sb3_piano.wrappers import HandActions
from sb3_piano.wrappers.piano import piano_of

Action = npt.NDArray[np.float32]

_JOINTS = 20
"""Actuators of a hand that turn a joint; then come its slider along the keyboard and the other."""


class Teacher(Player, Protocol):
    """A player that says in every state what would be right there."""

    def distance(self) -> float:
        """Return how far the hands are from where the teacher wants them.

        At 1 the teacher takes over.
        """


@contextlib.contextmanager
def new_teacher(
    settings: TeacherSettings, playing: PlayingSettings, env: HandActions
) -> Iterator[Teacher]:
    """Give a teacher, as long as the block lasts.

    Raises:
        ConfigError: If there is no such teacher, or it sees or does other than the learner.
        RunError: If a run's model cannot be loaded.
    """
    if settings.name == PLANNED:
        yield PlannedTeacher(settings.plan, playing, env)
        return
    if not os.path.isdir(settings.name):
        raise ConfigError(
            f"teacher.name is {settings.name!r}: expected {PLANNED!r}, or the folder of a run."
        )
    with OpenPlayer.open(settings.name) as player:
        model = player.model
        ours = env.observation_space, env.action_space
        if not isinstance(model, BaseAlgorithm) or ours != (
            model.observation_space,
            model.action_space,
        ):
            raise ConfigError(
                f"The run '{settings.name}' cannot teach: expected a trained model with "
                'observation="hands", reduced_action_space=False and HandActions around the piano, '
                "which sees and does what the learner does."
            )
        yield RunTeacher(player)


class PlannedTeacher:
    """Follows a plan of each excerpt, back to it by feedback from wherever the hands are.

    Args:
        settings: The plans' settings.
        playing: How far from the plan the teacher takes over.
        env: The environment.
    """

    def __init__(self, settings: PlanSettings, playing: PlayingSettings, env: HandActions) -> None:
        self._settings, self._playing, self._env = settings, playing, env
        self._piano = piano_of(env, "PlannedTeacher")

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Action, Any]:
        """Return what leads back to the plan, which is made at the beginning of an episode.

        Raises:
            ScoreError: If what the environment plays cannot be planned.
        """
        del observation, state, deterministic  # the plan goes by where the actuators are
        piano, settings = self._piano, self._settings
        if episode_start is not None and episode_start.any():
            made = plan(piano.roll, piano.scene, settings)
            self._tracker = Tracker(made, piano.scene, settings.feedback, settings.lift)
        controls = self._tracker.controls(piano.steps_played, self._positions())
        return self._env.action_for(controls), None

    def distance(self) -> float:
        """Return the greatest distance of a hand, relative to that of taking over."""
        step = self._piano.steps_played
        off = (self._positions() - self._tracker.plan.positions[step]).reshape(2, -1)
        along = np.abs(off[:, _JOINTS]) / self._playing.takeover_slider
        turned = np.sqrt((off[:, :_JOINTS] ** 2).mean(axis=1)) / self._playing.takeover_joints
        return float(max(along.max(), turned.max()))

    def _positions(self) -> npt.NDArray[np.float64]:
        piano = self._piano
        return self._tracker.positions(piano.data.qpos[piano.scene.hand_qpos])


class RunTeacher:
    """The model of a run, which sees what the learner sees; it never takes over.

    Args:
        player: The run's model.
    """

    def __init__(self, player: OpenPlayer) -> None:
        self._player = player

    def predict(self, observation: Any, *arguments: Any, **named: Any) -> tuple[Action, Any]:
        """Return what the model plays."""
        del arguments, named
        return self._player.predict(observation, deterministic=True)

    def distance(self) -> float:
        """Return 0: it wants the hands nowhere in particular."""
        return 0.0
