"""Score of an episode, chosen by the options of ``reset``."""

from __future__ import annotations

import functools
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.exceptions import ConfigError, SB3PianoError, ScoreError, one_line
from sb3_piano.hands import find_hand
from sb3_piano.music import Score, find_piece, load_score
from sb3_piano.music.catalogue import ScoreSource, is_path
from sb3_piano.music.fingering.apply import FINGERINGS, apply_fingering, without_fingers
from sb3_piano.music.fingering.split import assign_hands
from sb3_piano.music.hands import Hand


def own_score(source: ScoreSource, options: Mapping[str, Any]) -> tuple[Score, dict[str, Any]]:
    """Return the score that an environment plays by itself, and the options that are left.

    What may be chosen about a generated study (its tempo, its hands...) is an option of the
    environment that plays it.

    Raises:
        ConfigError: If an option of a study is out of range.
        ScoreError: If the score cannot be read.
        UnknownPieceError: If there is no piece of this name.
    """
    if not isinstance(source, str) or is_path(source):
        return load_score(source), dict(options)
    piece = find_piece(source)
    chosen = {name: options[name] for name in piece.options if name in options}
    # The environment has an option of the same name for all that it plays.
    left = {name: value for name, value in options.items() if name not in chosen or name == "hands"}
    return piece.score(**chosen), left


ScoreTransform = Callable[[Score, np.random.Generator], Score]
"""Makes the score that is played of the one that would be, with a given source of randomness."""


def part_of_hands(score: Score, config: PianoEnvConfig) -> Score:
    """Return the notes of the hands that play; the score itself if these are all.

    Which hands these are is for ``hands`` and ``hands_in_scene`` to say.

    Raises:
        ScoreError: If no note is left.
    """
    if config.hands != "both":
        score = _of_hand(assign_hands(score), config.hands)
    if len(config.sides) == 1:
        score = _of_hand(score, config.sides[0])
    return score


def _of_hand(score: Score, hand: Hand) -> Score:
    """Return the notes of a hand, who gets those of an unknown hand, too."""
    notes = tuple(
        note if note.hand == hand else replace(note, hand=hand)
        for note in score.notes
        if note.hand in (hand, None)
    )
    if not notes:
        raise ScoreError(
            f"{score.title!r} has no notes for the {hand} hand: expected a piece that it plays in, "
            "or other hands or hands_in_scene."
        )
    return score if notes == score.notes else replace(score, notes=notes)


_fingered = functools.lru_cache(maxsize=32)(apply_fingering)


def fingered(score: Score, config: PianoEnvConfig, fingering: str | None = None) -> Score:
    """Return a score with the fingering that an environment's option of this name asks for.

    Labels from a file are left to whoever knows the score that they belong to. Another fingering
    may be named in the option's place.
    """
    fingering = fingering or config.fingering
    if fingering not in FINGERINGS:
        return score
    # A hand whose part alone is played keeps its notes, also where their fingers are forgotten.
    both = config.hands == "both" and len(config.sides) != 1
    if fingering == "optimal-transport" and not both:
        return without_fingers(score, keep_hands=True)
    # Equal scores may differ in their bars, which make no difference to the fingers.
    robot = find_hand(config.hand)
    notes = _fingered(
        score, fingering, config.control_timestep, change_hands=both, robot=robot
    ).notes
    return score if notes == score.notes else replace(score, notes=notes)


def reset_options(options: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Return the options of a ``reset``; a ConfigError tells that they are none."""
    if not isinstance(options or {}, Mapping):
        raise ConfigError(
            f"The options of reset are {reprlib.repr(options)}: expected a dictionary with 'score' "
            "or 'transform'."
        )
    return options or {}


def chosen_score(options: Mapping[str, Any], default: Score, random: np.random.Generator) -> Score:
    """Return the score of an episode.

    Args:
        options: ``"score"``: a source to play in place of the default. ``"transform"``: a
            :data:`ScoreTransform` that changes it.
        default: What is played without options.
        random: The environment's random generator.

    Raises:
        ConfigError: If ``options`` has an unknown key, or the transform returns no score.
        ScoreError: If the score cannot be read or transformed.
    """
    for name in reset_options(options):
        if name not in ("score", "transform"):
            raise ConfigError(f"Unknown reset option {name!r}: expected 'score' or 'transform'.")
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
