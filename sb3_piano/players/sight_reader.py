"""Sight-reader: a learned network of one hand that plays any piece with both hands."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.envs.actions import HandActionMap
from sb3_piano.envs.hand_encoding import HandEncoding
from sb3_piano.envs.observation import ObservationLayout
from sb3_piano.exceptions import ConfigError, PlanWarning
from sb3_piano.layers import layers
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering.problems import summary, unheld
from sb3_piano.players.hand_model import SHIPPED, HandModel
from sb3_piano.players.policy import PianoPolicy, singles_of
from sb3_piano.simulation import PianoScene
from sb3_piano.wrappers.hand_actions import HandActions, hand_actions_of

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


class SightReader(PianoPolicy):
    """Play any piece by a learned network, without a plan, after reading it before its first note.

    It plays the pieces of its environments, also if wrappers choose them, with any observation. It
    uses the observation "hands" if given, and otherwise reads the simulation. Its actions are the
    environment's: the piano's own, or those of :class:`~sb3_piano.wrappers.HandActions`.

    Notes without a finger get one: one that matches the other notes' fingers, or the robot's if no
    note has one. A :class:`PlanWarning` lists notes that no finger can hold as written.

    Args:
        env: The environment, wrapped or not, or several of them in this process as a vector
            environment of Stable-Baselines3.
        model: The network of a hand, or its file; by default the one in the package.

    Raises:
        ConfigError: If the environment is no piano, or in another process; if the file is missing;
            if the network was trained for another control step, action space or observation.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any] | VecEnv,
        model: HandModel | str | os.PathLike[str] | None = None,
    ) -> None:
        super().__init__(env)
        name = "The sight-reader"
        if not isinstance(model, HandModel):
            name = f"The network of '{SHIPPED.name if model is None else model}'"
            model = HandModel.load(SHIPPED if model is None else model)
        self.model = model
        """The network of a hand."""
        self.num_timesteps = model.facts.num_timesteps
        for piano in self._pianos:
            model.check(piano, name)
        self._wrappers = [_hand_actions(single, env) for single in singles_of(env)]
        self._maps = [HandActionMap(piano.scene, model.facts.reach) for piano in self._pianos]
        self._read: list[_Read | None] = [None] * len(self._pianos)

    def _act(self, slot: int, step: int, observation: npt.NDArray[Any]) -> npt.NDArray[Any]:
        piano, wrapper, read = self._pianos[slot], self._wrappers[slot], self._reading(slot)
        step = min(step, len(piano.roll) - 1)
        if not read.shown:
            observation = read.encoding.write(step, piano.simulation, 0.0)
        action, own = self.model.act(observation), self._maps[slot]
        if wrapper is not None and np.array_equal(wrapper.reach, own.reach):
            return action
        positions = piano.scene.actuator_positions(piano.data.qpos[piano.scene.hand_qpos])
        controls = own.controls(action, positions)
        if wrapper is not None:
            return wrapper.action_for(controls)
        return piano.action_map.action(controls, pedal_down=bool(piano.roll.sustain[step]))

    def _reading(self, slot: int) -> _Read:
        """Return the reading of an environment's piece; read it if new."""
        piano, known = self._pianos[slot], self._read[slot]
        if known is not None and known.roll is piano.roll and known.scene is piano.scene:
            return known
        if known is not None and known.scene is piano.scene:  # else other keys are rigid now
            encoding = known.encoding
        else:
            version = self.model.facts.observation_version
            encoding = HandEncoding(piano.scene, replace(piano.config, hands_version=version))
        roll = piano.goal.fingered_roll
        problems = unheld(encoding.read(roll).roll)
        if piano.config.observation == "hands":  # the environment has warned of unlabelled notes
            problems = [one for one in problems if one.finger != UNKNOWN_FINGER]
        if problems:
            warnings.warn(summary(problems), PlanWarning, stacklevel=4)
        layout = self._layout if self._normalizer is None else None  # VecNormalize clips
        shown = layout is not None and _places(layout) == _places(encoding.layout)
        shown = shown and roll.equals(piano.asked_roll)  # ``goal_time`` may shift it
        self._read[slot] = made = _Read(piano.roll, piano.scene, encoding, shown)
        return made


@dataclass(frozen=True, eq=False)
class _Read:
    """Reading of a piece."""

    roll: PianoRoll
    """The environment's piano roll."""
    scene: PianoScene
    encoding: HandEncoding
    shown: bool
    """Whether the environment's observation is that of ``encoding``."""


def _places(layout: ObservationLayout) -> dict[str, slice]:
    return {name: block.slice for name, block in layout.items()}


def _hand_actions(single: gym.Env[Any, Any], env: gym.Env[Any, Any] | VecEnv) -> HandActions | None:
    """Find the wrapper whose actions an environment takes; ``None`` for the piano's own.

    Raises:
        ConfigError: If it takes other actions.
    """
    if any(isinstance(layer, HandActions) for layer in layers(single)):
        wrapper = hand_actions_of(single, "The sight-reader")
        if env.action_space == wrapper.action_space:
            return wrapper
    own = single.unwrapped.action_space
    if env.action_space != own:
        raise ConfigError(
            f"The sight-reader cannot act by {env.action_space}: expected the piano's own actions, "
            f"{own}, or those of sb3_piano.wrappers.HandActions, unchanged by other wrappers."
        )
    return None
