"""Register the environments' ids for ``gymnasium.make`` and ``make_vec``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import gymnasium as gym

from sb3_piano.user_data import piece_names, pieces_folder

# Read from a file, so that importing the package does not make the pieces; a test compares.
_NAMES = json.loads(Path(__file__).with_name("piece_names.json").read_text(encoding="utf-8"))

ENTRY_POINT = "sb3_piano.envs.piano_env:PianoEnv"
VECTOR_ENTRY_POINT = "sb3_piano.batch.vector_env:make_vector_env"

GENERAL_ID = "RoboPianist-v0"
"""The id for any score, given as ``score=``."""

_BENCHMARKS = ("debug-", "etude-12-", "repertoire-150-")
"""Prefixes of the names of the pieces of RoboPianist's own suite."""

SELF_ACTUATED_ID = "RoboPianist-selfactuated-v0"
"""The id of the piano without hands, whose keys have actuators."""

PIECE_IDS: Mapping[str, str] = MappingProxyType(
    {f"RoboPianist-{name}-v0": name for name in _NAMES["built_in"]}
)
"""Piece names by id, for all other ids; RoboPianist's own suite has the same ids."""

DEBUG_IDS = tuple(env_id for env_id, name in PIECE_IDS.items() if name.startswith("debug-"))
"""The ids of the debug set."""

ENV_IDS = (GENERAL_ID, SELF_ACTUATED_ID, *PIECE_IDS)
"""All ids that need no imported piece."""

PIG_IDS: Mapping[str, str] = MappingProxyType(
    {f"RoboPianist-{name}-v0": name for name in _NAMES["pig"]}
)
"""Piece names by id, for the PIG data set; they play once it is imported."""


def register_envs() -> None:
    """Register all ids with gymnasium, also of imported benchmark pieces; safe to repeat."""
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
                # After a refused first reset, Gymnasium's checker raises TypeError in step. The
                # environment checks actions and rewards itself.
                disable_env_checker=True,
                kwargs=kwargs,
            )


def imported_ids() -> dict[str, str]:
    """Return the ids of imported pieces of RoboPianist's suite, with the pieces' names."""
    try:
        names = piece_names(pieces_folder())
    except OSError:
        return {}  # the folder cannot be read: finding a piece in it raises that error
    return {f"RoboPianist-{name}-v0": name for name in names if name.startswith(_BENCHMARKS)}
