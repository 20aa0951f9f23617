"""The ids under which ``gymnasium.make`` and ``make_vec`` find the environments."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import gymnasium as gym

from sb3_piano.music import BUILT_IN
from sb3_piano.music.studies import DEBUG

ENTRY_POINT = "sb3_piano.envs.piano_env:PianoEnv"
VECTOR_ENTRY_POINT = "sb3_piano.envs.vector_env:PianoVectorEnv"

GENERAL_ID = "RoboPianist-v0"
"""The id that plays any score, given as ``score=``."""

PIECE_IDS: Mapping[str, str] = MappingProxyType(
    {f"RoboPianist-{name}-v0": name for name in BUILT_IN}
)
"""The name of the piece that each other id plays; those of RoboPianist's own suite are the same."""

DEBUG_IDS = tuple(f"RoboPianist-{name}-v0" for name in DEBUG)
"""The ids of the debug set."""

ENV_IDS = (GENERAL_ID, *PIECE_IDS)
"""All ids that this package registers."""


def register_envs() -> None:
    """Register all ids with gymnasium; safe to call twice."""
    for env_id, piece in {GENERAL_ID: "debug-TwinkleTwinkleLittleStar", **PIECE_IDS}.items():
        if env_id not in gym.registry:
            gym.register(
                id=env_id,
                entry_point=ENTRY_POINT,
                vector_entry_point=VECTOR_ENTRY_POINT,
                kwargs={"score": piece},
            )
