"""Guides of a tree search among players: what they would play, and what it is worth as music."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.envs import PianoEnv
from sb3_piano.players.policy import PianoPolicy

_PROPOSALS = 4
_GAMMA = 0.8
_KEY_PRESS, _STRIKE = 0.5, 0.3


class PlayerGuide:
    """Guide by a player that has no critics, such as the sight-reader.

    What it plays is varied by noise. A control step is worth its F1, half the reward term
    ``key_press``, which is more for keys that are nearly down, and 0.3 of ``strike``: of all
    strikes in time less the others. Where the tree ends, nothing is expected.

    Args:
        player: The player; it acts in the environment in which actions are tried.
        slot: Which of the player's environments that is.
        noise: (n,) standard deviation of what is added to its actions.
        random: What the noise is drawn from.
    """

    gamma = _GAMMA
    """Discount of a control step, that of the SAC in the source of the tree search."""

    def __init__(
        self, player: PianoPolicy, slot: int, noise: FloatArray, random: np.random.Generator
    ) -> None:
        self._player = player
        self._slot = slot
        self._noise = noise
        self._random = random

    def copied(self, memo: dict[int, Any]) -> PlayerGuide:
        """Return the same guide for a copy of the environment, which is in ``memo``."""
        return PlayerGuide(copy.deepcopy(self._player, memo), self._slot, self._noise, self._random)

    def reward(self, piano: PianoEnv, reward: float, info: Mapping[str, Any]) -> float:
        """Return what the last control step was worth."""
        del reward  # what a trained model is paid for
        due = int.from_bytes(piano.roll.active[piano.steps_played - 1].tobytes())
        sounding = int.from_bytes(piano.simulation.sounding)
        both = due.bit_count() + sounding.bit_count()
        f1 = 2 * (due & sounding).bit_count() / both if both else 1.0
        terms = info["reward_terms"]
        return float(f1 + _KEY_PRESS * terms["key_press"] + _STRIKE * terms["strike"])

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return what is expected of the moment in which the environment is, and what is played."""
        piano = self._player._pianos[self._slot]
        return 0.0, self._player._act(self._slot, piano.steps_played, observation)

    def propose(self, observation: Any, mode: Float32Array) -> list[Float32Array]:
        """Return variations of what is played."""
        del observation
        drawn = self._noise * self._random.standard_normal((_PROPOSALS, *mode.shape))
        return list(np.clip(mode + drawn, -1.0, 1.0).astype(np.float32))
