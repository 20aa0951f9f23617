"""Guide of a tree search by a player without critics."""

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
    """Guide of a tree search by a player without critics, such as the sight-reader.

    It proposes the player's action with added noise. The reward of a control step is its F1, plus
    half the reward term ``key_press``, which also rewards keys that are nearly down, plus 0.3 times
    ``strike``, the strikes in time minus the others. Leaves of the tree have the value 0.

    Args:
        player: The player; it acts in the environment in which actions are tried.
        slot: Index of that environment among the player's.
        noise: (n,) standard deviation of the noise on its actions.
        random: Random generator of the noise.
    """

    gamma = _GAMMA
    """Discount of a control step, as for SAC in the source of the tree search."""

    def __init__(
        self, player: PianoPolicy, slot: int, noise: FloatArray, random: np.random.Generator
    ) -> None:
        self._player = player
        self._slot = slot
        self._noise = noise
        self._random = random

    def copied(self, memo: dict[int, Any]) -> PlayerGuide:
        """Copy the guide for a copy of the environment, which is in ``memo``."""
        return PlayerGuide(copy.deepcopy(self._player, memo), self._slot, self._noise, self._random)

    def reward(self, piano: PianoEnv, reward: float, info: Mapping[str, Any]) -> float:
        """Compute the reward of the last control step."""
        del reward  # the environment's own reward is for trained models
        due = int.from_bytes(piano.roll.active[piano.steps_played - 1].tobytes())
        sounding = int.from_bytes(piano.simulation.sounding)
        both = due.bit_count() + sounding.bit_count()
        f1 = 2 * (due & sounding).bit_count() / both if both else 1.0
        terms = info["reward_terms"]
        return float(f1 + _KEY_PRESS * terms["key_press"] + _STRIKE * terms["strike"])

    def judge(self, observation: Any) -> tuple[float, Float32Array]:
        """Return the value of the environment's present state, which is 0, and the action."""
        piano = self._player._pianos[self._slot]
        return 0.0, self._player._act(self._slot, piano.steps_played, observation)

    def propose(self, observation: Any, mode: Float32Array) -> list[Float32Array]:
        """Draw variations of the player's action."""
        del observation
        drawn = self._noise * self._random.standard_normal((_PROPOSALS, *mode.shape))
        return list(np.clip(mode + drawn, -1.0, 1.0).astype(np.float32))
