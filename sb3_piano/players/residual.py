"""Residual actions: corrections of a player by an agent that learns one piece."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.exceptions import ConfigError
from sb3_piano.players.hand_model import SHIPPED, SIGHT_READER, HandModel
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.players.policy import PianoPolicy
from sb3_piano.players.sight_reader import SightReader
from sb3_piano.settings import Positive, checked, refuse_unknown
from sb3_piano.wrappers.hand_actions import hand_actions_of
from sb3_piano.wrappers.piano import piano_of
from sb3_piano.wrappers.residual import Residual

CORRECTED: Mapping[str, Callable[..., PianoPolicy]] = MappingProxyType(
    {SIGHT_READER: SightReader, "planned": PlannedPianist}
)
"""Class of what can be corrected, by its name."""


class PlayerResidual(Residual, gym.utils.RecordConstructorArgs):
    """Let the sight-reader or the planned pianist play, and the agent correct it.

    What is played is the player's action plus ``scale`` times the agent's, cut at -1 and 1. Actions
    of 0 play as the player does; the planned pianist, who plans a piece before its first step, as
    far as 32-bit numbers tell.

    Args:
        env: An environment that acts by :class:`~sb3_piano.wrappers.HandActions`, best with the
            observation "hands", by which the agent sees what the sight-reader does.
        player: "sight-reader" or "planned".
        scale: By how much an action of 1 changes the player's, above 0. With the reach that
            is usual, 0.05 is 0.06 rad of a finger's joint, half of that of a wrist's joint, and
            3 cm of what a slider is told, which it follows slowly.
        model: The file of the sight-reader's network, or a folder with a ``hand.safetensors``; by
            default the one that comes with the package.

    Raises:
        ConfigError: If an argument is wrong, the environment has other actions, there is no such
            file, or the network was trained for another environment.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        player: str = SIGHT_READER,
        scale: float = 0.05,
        model: str | os.PathLike[str] | None = None,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, player=player, scale=scale, model=model)
        inside = hand_actions_of(env, "PlayerResidual")
        if env.action_space != inside.action_space:
            raise ConfigError(
                f"PlayerResidual cannot correct actions of {env.action_space}: expected those "
                f"of HandActions, {inside.action_space}. Put wrappers that change them further out."
            )
        super().__init__(env, np.full(inside.reach.shape, checked("scale", scale, Positive)))
        refuse_unknown([player], CORRECTED, "player to be corrected")
        if player != SIGHT_READER and model is not None:
            raise ConfigError(
                f"model is '{model}', but {player!r} has no network: expected none, or the "
                "sight-reader."
            )
        self._piano, self._inside, self._model = piano_of(env, "PlayerResidual"), inside, model
        self._base: PianoPolicy = CORRECTED[player](env, *([] if model is None else [model]))

    @property
    def standardization(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, (n,), of what a hand observes, as the sight-reader's."""
        tensors = HandModel.load(SHIPPED if self._model is None else self._model).tensors
        mean, scale = (tensors[f"standardize.{name}"].astype(float) for name in ("mean", "scale"))
        return mean, 1 / scale

    def base_action(self, observation: Any) -> Float32Array:
        """Return the player's action."""
        played, _ = self._base.predict(observation)
        if played.shape == self.action_space.shape:
            return played
        controls, _ = self._piano.action_map.controls(played)  # the score moves the pedal
        return self._inside.action_for(controls)
