"""Factory of players by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import gymnasium as gym

from sb3_piano.players.planned import PlannedPianist
from sb3_piano.players.policy import PianoPolicy
from sb3_piano.players.sampling import PredictiveSampling
from sb3_piano.players.sight_reader import SightReader
from sb3_piano.settings import refuse_unknown

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


PLAYERS: Mapping[str, type[PianoPolicy]] = MappingProxyType(
    {"planned": PlannedPianist, "sampling": PredictiveSampling, "sight-reader": SightReader}
)
"""Classes of the players that need no training on a piece, by name."""


def player_class(name: str) -> type[PianoPolicy]:
    """Return the class of a player, one of :data:`PLAYERS`.

    Raises:
        ConfigError: If no player has this name.
    """
    refuse_unknown([name], PLAYERS, "player")
    return PLAYERS[name]


def make_player(name: str, env: gym.Env[Any, Any] | VecEnv, **settings: Any) -> PianoPolicy:
    """Make a player, which has SB3's ``predict``, for an environment.

    Args:
        name: One of :data:`PLAYERS`.
        env: The environment, wrapped or not, or several of them in this process as a vector
            environment of Stable-Baselines3.
        **settings: Arguments of the player's class, such as ``model`` or ``samples``.

    Raises:
        ConfigError: If no player has this name, or it cannot play there.
    """
    make: Any = player_class(name)
    player: PianoPolicy = make(env, **settings)
    return player
