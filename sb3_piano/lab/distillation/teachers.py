"""Teachers: players that label each state with an expert action."""

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
from sb3_piano.wrappers.piano import unwrap_piano

Action = npt.NDArray[np.float32]

_JOINTS = 20
"""Actuators of a hand's joints; its slider along the keyboard and the other slider follow."""


class Teacher(Player, Protocol):
    """A player that gives the expert action in every state."""

    def distance(self) -> float:
        """Return the distance of the hands from the teacher's target.

        At 1 the teacher takes over.
        """


@contextlib.contextmanager
def new_teacher(
    settings: TeacherSettings, playing: PlayingSettings, env: HandActions
) -> Iterator[Teacher]:
    """Yield a teacher for the duration of the block.

    Raises:
        ConfigError: If there is no such teacher, or its spaces differ from the learner's.
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
                "with the spaces of the learner."
            )
        yield RunTeacher(player)


class PlannedTeacher:
    """Teacher that follows a plan of each excerpt, with feedback from the hands' positions.

    Args:
        settings: Settings of the plans.
        playing: Distances at which the teacher takes over.
        env: The environment.
    """

    def __init__(self, settings: PlanSettings, playing: PlayingSettings, env: HandActions) -> None:
        self._settings, self._playing, self._env = settings, playing, env
        self._piano = unwrap_piano(env, "PlannedTeacher")

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Action, Any]:
        """Return the action that leads back to the plan; an episode's start makes a new plan.

        Raises:
            ScoreError: If the environment's score cannot be planned.
        """
        del observation, state, deterministic  # the plan uses the actuators' positions
        piano, settings = self._piano, self._settings
        if episode_start is not None and episode_start.any():
            made = plan(piano.roll, piano.scene, settings)
            self._tracker = Tracker(made, piano.scene, settings.feedback, settings.lift)
        controls = self._tracker.controls(piano.steps_played, self._positions())
        return self._env.action_for(controls), None

    def distance(self) -> float:
        """Return the greatest distance of a hand, relative to the takeover distance."""
        step = self._piano.steps_played
        off = (self._positions() - self._tracker.plan.positions[step]).reshape(2, -1)
        along = np.abs(off[:, _JOINTS]) / self._playing.takeover_slider
        turned = np.sqrt((off[:, :_JOINTS] ** 2).mean(axis=1)) / self._playing.takeover_joints
        return float(max(along.max(), turned.max()))

    def _positions(self) -> npt.NDArray[np.float64]:
        piano = self._piano
        return self._tracker.positions(piano.data.qpos[piano.scene.hand_qpos])


class RunTeacher:
    """Teacher from a run's model, with the learner's observations; it never takes over.

    Args:
        player: The run's model.
    """

    def __init__(self, player: OpenPlayer) -> None:
        self._player = player

    def predict(self, observation: Any, *arguments: Any, **named: Any) -> tuple[Action, Any]:
        """Return the model's deterministic action."""
        del arguments, named
        return self._player.predict(observation, deterministic=True)

    def distance(self) -> float:
        """Return 0: it has no target positions."""
        return 0.0
