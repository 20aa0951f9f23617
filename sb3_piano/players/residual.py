"""Residual actions: corrections of the sight-reader by an agent that learns one piece."""

from __future__ import annotations

import os
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ConfigError, InvalidActionError
from sb3_piano.players.hand_model import HandModel
from sb3_piano.players.sight_reader import SightReader
from sb3_piano.settings import Positive, checked
from sb3_piano.wrappers.hand_actions import CorrectsHandActions, hand_actions_of

FloatArray = npt.NDArray[np.floating]


class SightReaderResidual(
    gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs, CorrectsHandActions
):
    """Let the sight-reader play, and the agent correct it.

    What is played is the action of :class:`~sb3_piano.players.SightReader` plus ``scale`` times the
    agent's, cut at -1 and 1. Actions of 0 play as the sight-reader does. Observations are those of
    the environment.

    Wrappers inside of this one get what is played, those outside what the agent does.

    Source: residual policies (Silver et al. 2018, "Residual Policy Learning"; Johannink et al.
    2019, "Residual Reinforcement Learning for Robot Control").

    Args:
        env: An environment that acts by :class:`~sb3_piano.wrappers.HandActions`, best with the
            observation "hands", by which the agent sees what the sight-reader does.
        scale: By how much an action of 1 changes the sight-reader's, above 0. With the reach that
            is usual, 0.05 is 0.06 rad of a finger's joint, half of that of a wrist's joint, and
            3 cm of what a slider is told, which it follows slowly.
        model: The file of the network of a hand, or a folder with a ``hand.safetensors``; by
            default the one that comes with the package.

    Raises:
        ConfigError: If ``scale`` is out of range, the environment has other actions, there is no
            such file, or the network was trained for another environment.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        scale: float = 0.05,
        model: str | os.PathLike[str] | None = None,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, scale=scale, model=model)
        inside = hand_actions_of(env, "SightReaderResidual")
        if env.action_space != inside.action_space:
            raise ConfigError(
                f"SightReaderResidual cannot correct actions of {env.action_space}: expected those "
                f"of HandActions, {inside.action_space}. Put wrappers that change them further out."
            )
        super().__init__(env)
        self._scale = np.float32(checked("scale", scale, Positive))
        self._base = SightReader(env, model)
        self._seen: Any = None

    @property
    def base(self) -> HandModel:
        """The sight-reader's network."""
        return self._base.model

    @property
    def standardization(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, (n,), by which the network takes a hand's observation."""
        tensors = self.base.tensors
        return tensors["standardize.mean"], 1 / tensors["standardize.scale"]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        self._seen, info = self.env.reset(seed=seed, options=options)
        return self._seen, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step of the sight-reader's, corrected.

        Raises:
            InvalidActionError: If the action has the wrong shape.
        """
        correction = np.asarray(action, dtype=np.float32)
        if correction.shape != self.action_space.shape:
            raise InvalidActionError(
                f"The action has shape {correction.shape}: expected {self.action_space.shape}, one "
                "number for each actuator and none for the pedal."
            )
        played, _ = self._base.predict(self._seen)
        played += self._scale * np.minimum(np.maximum(correction, -1.0), 1.0)
        self._seen, *result = self.env.step(np.minimum(np.maximum(played, -1.0), 1.0))
        return self._seen, *result
