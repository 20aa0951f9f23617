"""The ids under which ``gymnasium.make`` and ``make_vec`` find the environments."""

from __future__ import annotations

import gymnasium as gym

from sb3_piano.music import STUDIES

ENTRY_POINT = "sb3_piano.envs.piano_env:PianoEnv"
VECTOR_ENTRY_POINT = "sb3_piano.envs.vector_env:PianoVectorEnv"

GENERAL_ID = "RoboPianist-v0"
"""The id that plays any score, given as ``score=``."""

DEBUG_IDS = tuple(f"RoboPianist-debug-{name}-v0" for name in STUDIES)
"""The ids of the studies, under the names of RoboPianist's own suite."""

ENV_IDS = (GENERAL_ID, *DEBUG_IDS)
"""All ids that this package registers."""


def register_envs() -> None:
    """Register all ids with gymnasium; safe to call twice."""
    scores = {GENERAL_ID: "TwinkleTwinkleLittleStar", **dict(zip(DEBUG_IDS, STUDIES, strict=True))}
    for env_id in ENV_IDS:
        if env_id not in gym.registry:
            gym.register(
                id=env_id,
                entry_point=ENTRY_POINT,
                vector_entry_point=VECTOR_ENTRY_POINT,
                kwargs={"score": scores[env_id]},
            )
