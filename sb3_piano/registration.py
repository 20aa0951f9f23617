"""The ids under which ``gymnasium.make`` and ``make_vec`` find the environments."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import gymnasium as gym

from sb3_piano.user_data import piece_names, pieces_folder

# They stand in a file, so that importing the package does not make the pieces: a test compares.
_NAMES = json.loads(Path(__file__).with_name("piece_names.json").read_text(encoding="utf-8"))

ENTRY_POINT = "sb3_piano.envs.piano_env:PianoEnv"
VECTOR_ENTRY_POINT = "sb3_piano.batch.vector_env:make_vector_env"

GENERAL_ID = "RoboPianist-v0"
"""The id that plays any score, given as ``score=``."""

_BENCHMARKS = ("debug-", "etude-12-", "repertoire-150-")
"""Prefixes of the names of the pieces of RoboPianist's own suite."""

SELF_ACTUATED_ID = "RoboPianist-selfactuated-v0"
"""The id of the piano without hands, whose keys are driven."""

PIECE_IDS: Mapping[str, str] = MappingProxyType(
    {f"RoboPianist-{name}-v0": name for name in _NAMES["built_in"]}
)
"""The name of the piece that each other id plays; those of RoboPianist's own suite are the same."""

DEBUG_IDS = tuple(env_id for env_id, name in PIECE_IDS.items() if name.startswith("debug-"))
"""The ids of the debug set."""

ENV_IDS = (GENERAL_ID, SELF_ACTUATED_ID, *PIECE_IDS)
"""All ids of what comes with the package."""

PIG_IDS: Mapping[str, str] = MappingProxyType(
    {f"RoboPianist-{name}-v0": name for name in _NAMES["pig"]}
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
    for env_id, piece in PIECE_IDS.items():
        if piece.startswith("encore-"):  # which have no fingers of their own
            options[env_id]["fingering"] = "ergonomic"
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
        names = piece_names(pieces_folder())
    except OSError:
        return {}  # a folder that cannot be read: finding a piece in it says so
    return {f"RoboPianist-{name}-v0": name for name in names if name.startswith(_BENCHMARKS)}
