"""Actions of hands, each a right hand's, that begin where the hand is."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.envs.actions import (
    REACH,
    HandActionMap,
    action_numbers,
    check_finite,
    hand_action_unit,
)
from sb3_piano.exceptions import ConfigError, InvalidActionError
from sb3_piano.layers import layers
from sb3_piano.wrappers.piano import piano_of


class HandActions(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Take actions as offsets from where the actuators are, all hands as right hands.

    The action has one number in [-1, 1] for each actuator and none for the pedal, which is moved as
    the score asks. An actuator is told where it is plus its reach times the number, cut at the ends
    of its control range; the left hand's slider along the keyboard moves the other way, so that
    what moves the right hand to the right moves the left one to the left. With the observation
    "hands" both hands see and do the same in the mirror, and one network can play either.

    Args:
        env: A piano environment, wrapped or not.
        reach: How far from where it is an action of 1 sends a finger's joint, rad, above 0; a
            wrist's joint half as far, a slider half as many metres, since it follows slowly.

    Raises:
        ConfigError: If ``reach`` is out of range, ``env`` is no piano or has no hands, or another
            wrapper inside has changed the actions.
    """

    def __init__(self, env: gym.Env[Any, Any], reach: float = REACH) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, reach=reach)
        super().__init__(env)
        self._piano = piano_of(env, "HandActions")
        if not self._piano.scene.sides:
            raise ConfigError("HandActions finds no hands in the scene: expected one or two.")
        own = self._piano.action_space
        if env.action_space != own:
            raise ConfigError(
                f"HandActions cannot stand for actions of {env.action_space}: expected those of "
                f"the piano itself, {own}. Put wrappers that change them further out."
            )
        self.map = HandActionMap(self._piano.scene, reach)
        """Map from these actions to the actuators' targets, and back."""
        self.action_space = self.map.space

    @property
    def reach(self) -> FloatArray:
        """(n,) what an action of 1 adds, rad, or m for the sliders; negative in the mirror."""
        return self.map.reach

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step.

        Raises:
            InvalidActionError: If the action has the wrong shape or is not finite.
        """
        return self.env.step(self.piano_action(action))

    def piano_action(self, action: npt.ArrayLike) -> Float32Array:
        """Return the action of the piano itself that an action stands for in the present state.

        Raises:
            InvalidActionError: If the action has the wrong shape or is not finite.
        """
        offsets = action_numbers(action)
        if offsets.shape != self.reach.shape:
            raise InvalidActionError(
                f"The action has shape {offsets.shape}: expected {self.reach.shape}, one number "
                "for each actuator and none for the pedal."
            )
        check_finite(offsets)
        piano, roll = self._piano, self._piano.roll
        controls = self.map.controls(offsets, self._positions())
        down = bool(roll.sustain[min(piano.steps_played, len(roll) - 1)])
        return piano.action_map.action(controls, pedal_down=down)

    def action_for(self, controls: FloatArray) -> Float32Array:
        """Return the action that tells the actuators something, (n,) rad or m, within its reach."""
        return self.map.action(controls, self._positions())

    def _positions(self) -> FloatArray:
        piano = self._piano
        return piano.scene.actuator_positions(piano.data.qpos[piano.scene.hand_qpos])


def change_of_actions(env: gym.Env[Any, Any], rad: float, asker: str) -> FloatArray:
    """Return by how much actions change where a finger's joint is told to go elsewhere by ``rad``.

    Returns:
        (n,) a number for each actuator: other ones go as far as moves a fingertip as much.

    Raises:
        ConfigError: If the actions are neither the piano's own nor those of :class:`HandActions`;
            the message names who asks.
    """
    piano = piano_of(env, asker)
    if env.action_space == piano.action_space:
        return piano.action_map.change(rad * hand_action_unit(piano.scene))
    inside = hand_actions_of(env, asker)
    if env.action_space != inside.action_space:
        raise ConfigError(
            f"{asker} cannot change actions of {env.action_space}: expected the piano's own, "
            f"{piano.action_space}, or those of HandActions."
        )
    return np.full(inside.reach.shape, rad / np.abs(inside.reach).max())


class CorrectsHandActions:
    """Marks wrappers further out whose actions are of the same space and mean something else."""


def hand_actions_of(env: gym.Env[Any, Any], asker: str) -> HandActions:
    """Return the wrapper among those around a piano.

    Raises:
        ConfigError: If it is not there, or its actions are corrected further out; the message names
            who asks.
    """
    for layer in layers(env):
        if isinstance(layer, CorrectsHandActions):
            raise ConfigError(
                f"{asker} finds {type(layer).__name__}, whose actions are corrections: expected "
                "HandActions without it."
            )
        if isinstance(layer, HandActions):
            return layer
    raise ConfigError(
        f"{asker} finds no HandActions around the piano: expected "
        "sb3_piano.wrappers.HandActions among the wrappers."
    )
