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
from sb3_piano.wrappers.piano import unwrap_piano
from sb3_piano.wrappers.residual import Residual

CORRECTED: Mapping[str, Callable[..., PianoPolicy]] = MappingProxyType(
    {SIGHT_READER: SightReader, "planned": PlannedPianist}
)
"""Classes of players that can be corrected, by name."""


class PlayerResidual(Residual, gym.utils.RecordConstructorArgs):
    """Add ``scale`` times the agent's action to the action of the sight-reader or planned pianist.

    The sum is clipped to [-1, 1]. Actions of 0 play exactly like the player; for the planned
    pianist, up to the precision of 32-bit numbers. The planned pianist plans a piece before its
    first step.

    Args:
        env: An environment with :class:`~sb3_piano.wrappers.HandActions`, best with the
            observation "hands", so that the agent sees the sight-reader's observation.
        player: "sight-reader" or "planned".
        scale: Change of the player's action by an action of 1, above 0. With the default reach,
            0.05 changes the target of a finger joint by 0.06 rad, of a wrist joint by 0.03 rad, and
            of a slider, which follows slowly, by 3 cm.
        model: The file of the sight-reader's network, or a folder with a ``hand.safetensors``; by
            default the network in the package.

    Raises:
        ConfigError: If an argument is wrong, the environment has other actions, the file is
            missing, or the network was trained for another environment.
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
        self._piano, self._inside, self._model = unwrap_piano(env, "PlayerResidual"), inside, model
        self._base: PianoPolicy = CORRECTED[player](env, *([] if model is None else [model]))

    @property
    def standardization(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, (n,), of a hand's observation in the sight-reader."""
        model = HandModel.load(SHIPPED if self._model is None else self._model)
        config = self._piano.config
        if config.observation == "hands" and config.hands_version > 1:
            model = model.newest()
        tensors = model.tensors
        mean, scale = (tensors[f"standardize.{name}"].astype(float) for name in ("mean", "scale"))
        return mean, 1 / scale

    def base_action(self, observation: Any) -> Float32Array:
        """Return the player's action."""
        played, _ = self._base.predict(observation)
        if played.shape == self.action_space.shape:
            return played
        controls, _ = self._piano.action_map.controls(played)  # the score moves the pedal
        return self._inside.action_for(controls)
