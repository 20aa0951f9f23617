"""The sight-reader: one learned network of a hand plays any piece at once, with both hands."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
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
from sb3_piano.players.hand_model import SHIPPED, HandModel
from sb3_piano.players.policy import PianoPolicy, singles_of
from sb3_piano.reading.problems import summary, unheld
from sb3_piano.simulation import PianoScene
from sb3_piano.wrappers.hand_actions import HandActions, hand_actions_of

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


class SightReader(PianoPolicy):
    """Reads each piece before its first note, and plays it by a learned network, without a plan.

    It plays whatever its environments play, also where wrappers choose the piece, and whatever they
    observe: with the observation "hands" it goes by what it is given, otherwise it looks at the
    simulation itself. Its actions are those of the environment: the piano's own, or those of
    :class:`~sb3_piano.wrappers.HandActions`.

    Notes without a finger get one: the robot's, or, where other notes have fingers, one that goes
    with those. A :class:`PlanWarning` tells of notes that no finger can hold as they are written.

    Args:
        env: The environment, wrapped or not, or several of them in this process as a vector
            environment of Stable-Baselines3.
        model: The network of a hand, or its file; by default the one that comes with the package.

    Raises:
        ConfigError: If the environment is no piano, or out of reach in another process; if there is
            no such file; if the network was trained for another control step, action space or
            observation.
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
        """Return what was read of the piece that an environment plays, or read it."""
        piano, known = self._pianos[slot], self._read[slot]
        if known is not None and known.roll is piano.roll and known.scene is piano.scene:
            return known
        if known is not None and known.scene is piano.scene:  # otherwise other keys are rigid now
            encoding = known.encoding
        else:
            encoding = HandEncoding(piano.scene, piano.config)
        roll = piano.goal.fingered_roll
        problems = unheld(encoding.read(roll).roll)
        if piano.config.observation == "hands":  # the environment has told of those without finger
            problems = [one for one in problems if one.finger != UNKNOWN_FINGER]
        if problems:
            warnings.warn(summary(problems), PlanWarning, stacklevel=4)
        layout = self._layout if self._normalizer is None else None  # which cuts what is far off
        shown = layout is not None and _places(layout) == _places(encoding.layout)
        shown = shown and roll.equals(piano.asked_roll)  # which ``goal_time`` may shift
        self._read[slot] = made = _Read(piano.roll, piano.scene, encoding, shown)
        return made


@dataclass(frozen=True, eq=False)
class _Read:
    """A piece that was read."""

    roll: PianoRoll
    """The piece, as the environment has it."""
    scene: PianoScene
    encoding: HandEncoding
    shown: bool
    """Whether the environment shows the same."""


def _places(layout: ObservationLayout) -> dict[str, slice]:
    return {name: block.slice for name, block in layout.items()}


def _hand_actions(single: gym.Env[Any, Any], env: gym.Env[Any, Any] | VecEnv) -> HandActions | None:
    """Return the wrapper whose actions an environment takes; ``None`` for the piano's own.

    Raises:
        ConfigError: If it takes others.
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
