"""Wrapper with mirrored, relative actions of hands."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

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
from sb3_piano.wrappers.piano import unwrap_piano


class HandActions(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Take actions as offsets from the actuators' positions, all hands as right hands.

    The action has one number in [-1, 1] for each actuator and none for the pedal, which follows the
    score. The target of an actuator is its position plus its reach times the number, clipped to its
    control range. The left hand's slider along the keyboard is mirrored. With the observation
    "hands" both hands see and do the same, mirrored, so that one network can play either.

    Args:
        env: A piano environment, wrapped or not.
        reach: Offset of a finger joint's target by an action of 1, rad, above 0. A wrist's joint
            gets half of it, a slider, which follows slowly, half as many metres, and a forearm's
            turn 0.15 of it.

    Raises:
        ConfigError: If ``reach`` is out of range, ``env`` is no piano or has no hands, or another
            wrapper inside has changed the actions.
    """

    def __init__(self, env: gym.Env[Any, Any], reach: float = REACH) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, reach=reach)
        super().__init__(env)
        self._piano = unwrap_piano(env, "HandActions")
        if not self._piano.scene.sides:
            raise ConfigError("HandActions finds no hands in the scene: expected one or two.")
        own = self._piano.action_space
        if env.action_space != own:
            raise ConfigError(
                f"HandActions cannot replace actions of {env.action_space}: expected the piano's "
                f"own, {own}. Put wrappers that change them further out."
            )
        self.map = HandActionMap(self._piano.scene, reach)
        """Map from these actions to the actuators' targets, and back."""
        self.action_space = spaces.Box(-1.0, 1.0, self.reach.shape, dtype=np.float32)

    @property
    def reach(self) -> FloatArray:
        """(n,) offset of an action of 1, rad, or m for the sliders; negative in the mirror."""
        return self.map.reach

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step.

        Raises:
            InvalidActionError: If the action has the wrong shape or is not finite.
        """
        return self.env.step(self.piano_action(action))

    def piano_action(self, action: npt.ArrayLike) -> Float32Array:
        """Convert an action to the piano's own action in the present state.

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
        """Return the action that sets actuator targets, (n,) rad or m, as far as it reaches."""
        return self.map.action(controls, self._positions())

    def _positions(self) -> FloatArray:
        piano = self._piano
        return piano.scene.actuator_positions(piano.data.qpos[piano.scene.hand_qpos])


def change_of_actions(env: gym.Env[Any, Any], rad: float, caller: str) -> FloatArray:
    """Return the change of each action that moves a finger joint's target by ``rad``.

    Returns:
        (n,) a number for each actuator: other ones go as far as moves a fingertip as much.

    Raises:
        ConfigError: If the actions are neither the piano's own nor those of :class:`HandActions`;
            the message names the caller.
    """
    piano = unwrap_piano(env, caller)
    if env.action_space == piano.action_space:
        return piano.action_map.change(rad * hand_action_unit(piano.scene))
    inside = hand_actions_of(env, caller)
    if env.action_space != inside.action_space:
        raise ConfigError(
            f"{caller} cannot change actions of {env.action_space}: expected the piano's own, "
            f"{piano.action_space}, or those of HandActions."
        )
    return np.full(inside.reach.shape, rad / np.abs(inside.reach).max())


class CorrectsHandActions:
    """Mixin of wrappers whose actions are corrections, added to those of ``HandActions``."""


def hand_actions_of(env: gym.Env[Any, Any], caller: str) -> HandActions:
    """Return the ``HandActions`` around a piano.

    Raises:
        ConfigError: If it is not there, or its actions are corrected further out; the message names
            who asks.
    """
    for layer in layers(env):
        if isinstance(layer, CorrectsHandActions):
            raise ConfigError(
                f"{caller} finds {type(layer).__name__}, whose actions are corrections: expected "
                "HandActions without it."
            )
        if isinstance(layer, HandActions):
            return layer
    raise ConfigError(
        f"{caller} finds no HandActions around the piano: expected "
        "sb3_piano.wrappers.HandActions among the wrappers."
    )
