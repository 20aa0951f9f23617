"""Choice of an episode's score by the options of the environment and of ``reset``."""

from __future__ import annotations

import functools
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.exceptions import ConfigError, SB3PianoError, one_line
from sb3_piano.hands import find_hand
from sb3_piano.music import Score, find_piece, load_score
from sb3_piano.music.catalogue import ScoreSource, is_path
from sb3_piano.music.fingering.apply import FINGERINGS, apply_fingering, without_fingers
from sb3_piano.music.fingering.split import assign_hands, of_hand
from sb3_piano.settings import refuse_unknown


def own_score(source: ScoreSource, options: Mapping[str, Any]) -> tuple[Score, dict[str, Any]]:
    """Load an environment's default score; return it and the remaining options.

    The options of a generated study (its tempo, its hands...) are options of the environment that
    plays it.

    Raises:
        ConfigError: If an option of a study is out of range.
        ScoreError: If the score cannot be read.
        UnknownPieceError: If no piece has this name.
    """
    if not isinstance(source, str) or is_path(source):
        return load_score(source), dict(options)
    piece = find_piece(source)
    chosen = {name: options[name] for name in piece.options if name in options}
    # The environment has an option `hands`, too, for all its scores.
    left = {name: value for name, value in options.items() if name not in chosen or name == "hands"}
    return piece.score(**chosen), left


ScoreTransform = Callable[[Score, np.random.Generator], Score]
"""Function that changes the score of an episode, with a random generator."""


def part_of_hands(score: Score, config: PianoEnvConfig) -> Score:
    """Return the notes for the hands that play; the score itself if these are all.

    Raises:
        ScoreError: If no note is left under the options ``hands`` and ``hands_in_scene``.
    """
    if config.hands != "both":
        score = of_hand(assign_hands(score), config.hands)
    if len(config.sides) == 1:
        score = of_hand(score, config.sides[0])
    return score


_fingered = functools.lru_cache(maxsize=32)(apply_fingering)


def fingered(score: Score, config: PianoEnvConfig, fingering: str | None = None) -> Score:
    """Apply the fingering of an environment's option, or another one, to a score.

    Labels from a file are not applied here, as they belong to one score only; the environment
    applies them.
    """
    fingering = fingering or config.fingering
    if fingering not in FINGERINGS:
        return score
    # If one hand plays alone, its notes keep that hand when their fingers are removed.
    both = config.hands == "both" and len(config.sides) != 1
    if fingering == "optimal-transport" and not both:
        return without_fingers(score, keep_hands=True)
    # The cache ignores bars: scores that compare equal may differ in them.
    more = {"change_hands": both, "robot": find_hand(config.hand)}
    notes = _fingered(score, fingering, config.control_timestep, **more).notes
    return score if notes == score.notes else replace(score, notes=notes)


def reset_options(options: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Check that the options of a ``reset`` are a mapping; else raise a ConfigError."""
    if not isinstance(options or {}, Mapping):
        raise ConfigError(
            f"The options of reset are {reprlib.repr(options)}: expected a dictionary with 'score' "
            "or 'transform'."
        )
    return options or {}


def chosen_score(options: Mapping[str, Any], default: Score, random: np.random.Generator) -> Score:
    """Choose the score of an episode, ``default`` without options, as ``PianoEnv.reset`` does.

    Raises:
        ConfigError: If ``options`` has an unknown key, or the transform returns no score.
        ScoreError: If the score cannot be read or transformed.
    """
    refuse_unknown(reset_options(options), ("score", "transform"), "reset option")
    score = load_score(options.get("score", default))
    if "transform" not in options:
        return score
    transform = options["transform"]
    try:
        transformed = transform(score, random)
    except SB3PianoError:
        raise
    except Exception as error:
        raise ConfigError(
            f"The reset option 'transform' is {reprlib.repr(transform)}, which ends with "
            f"{type(error).__name__} ({one_line(error)}) for {score.title!r}: expected a function "
            "of a Score and of a random generator that returns a Score."
        ) from error
    if not isinstance(transformed, Score):
        raise ConfigError(
            f"The reset option 'transform' made a {type(transformed).__name__} of "
            f"{score.title!r}: expected a function that returns a Score."
        )
    return transformed
