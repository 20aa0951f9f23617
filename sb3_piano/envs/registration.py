"""The ids under which ``gymnasium.make`` and ``make_vec`` find the environments."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import gymnasium as gym

from sb3_piano.music import BUILT_IN
from sb3_piano.music.built_in import ENCORE
from sb3_piano.music.library import PIG_PIECES, Library
from sb3_piano.music.studies import DEBUG

ENTRY_POINT = "sb3_piano.envs.piano_env:PianoEnv"
VECTOR_ENTRY_POINT = "sb3_piano.envs.vector_env:PianoVectorEnv"

GENERAL_ID = "RoboPianist-v0"
"""The id that plays any score, given as ``score=``."""

_BENCHMARKS = ("debug-", "etude-12-", "repertoire-150-")
"""Prefixes of the names of the pieces of RoboPianist's own suite."""

SELF_ACTUATED_ID = "RoboPianist-selfactuated-v0"
"""The id of the piano without hands, whose keys are driven."""

PIECE_IDS: Mapping[str, str] = MappingProxyType(
    {f"RoboPianist-{name}-v0": name for name in BUILT_IN}
)
"""The name of the piece that each other id plays; those of RoboPianist's own suite are the same."""

DEBUG_IDS = tuple(f"RoboPianist-{name}-v0" for name in DEBUG)
"""The ids of the debug set."""

ENV_IDS = (GENERAL_ID, SELF_ACTUATED_ID, *PIECE_IDS)
"""All ids of what comes with the package."""

PIG_IDS: Mapping[str, str] = MappingProxyType(
    {f"RoboPianist-{name}-v0": name for name in PIG_PIECES}
)
"""The same for the pieces of the PIG data set, which play once it has been imported."""


def register_envs() -> None:
    """Register all ids with gymnasium, those of imported benchmark pieces too; safe to repeat."""
    twinkle = {"score": "debug-TwinkleTwinkleLittleStar"}
    options: dict[str, dict[str, Any]] = {
        GENERAL_ID: twinkle,
        SELF_ACTUATED_ID: {**twinkle, "hands_in_scene": "none", "n_steps_lookahead": 0},
    }
    pieces = {**PIECE_IDS, **PIG_IDS, **imported_ids()}
    options.update({env_id: {"score": piece} for env_id, piece in pieces.items()})
    for piece in ENCORE:  # which have no fingers of their own
        options[f"RoboPianist-{piece}-v0"]["fingering"] = "ergonomic"
    for env_id, kwargs in options.items():
        if env_id not in gym.registry:
            gym.register(
                id=env_id,
                entry_point=ENTRY_POINT,
                vector_entry_point=VECTOR_ENTRY_POINT,
                kwargs=kwargs,
            )


def imported_ids() -> dict[str, str]:
    """Return the ids of imported pieces that RoboPianist has ids for, with the pieces' names."""
    try:
        names = Library().names()  # without reading their files
    except OSError:
        return {}  # a folder that cannot be read: finding a piece in it says so
    return {f"RoboPianist-{name}-v0": name for name in names if name.startswith(_BENCHMARKS)}
