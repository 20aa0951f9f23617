"""What may be chosen about a generated study, and the checks of what was chosen."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.music.constants import MAX_PITCH
from sb3_piano.music.hands import HANDS, Hand

MIN_TEMPO, MAX_TEMPO = 1.0, 1000.0
"""Slowest and fastest tempo, in quarter notes a minute: wider than anybody plays."""

HAND_CHOICES: Mapping[str, tuple[Hand, ...]] = MappingProxyType(
    {"both": HANDS, "right": ("right",), "left": ("left",)}
)
"""The hands that play, by the value of the option `hands`."""


def option_meanings(*, tempo: int, octaves: int) -> dict[str, str]:
    """Return what the options that all studies have mean, by name.

    Args:
        tempo: The study's own tempo, in quarter notes a minute.
        octaves: How many octaves it spans by itself.
    """
    return {
        "tempo": f"quarter notes a minute, {MIN_TEMPO:g} to {MAX_TEMPO:g} (default {tempo})",
        "hands": "who plays: both (default), right or left",
        "repeats": "how many times in a row it is played, 1 or more (default 1)",
        "octaves": f"how many octaves it climbs, as far as the keyboard goes (default {octaves})",
    }


def quarter_duration(tempo: Any) -> float:
    """Return the length of a quarter note, in s.

    Raises:
        ConfigError: If `tempo` is no number of quarter notes a minute within the limits.
    """
    if _is_number(tempo) and MIN_TEMPO <= tempo <= MAX_TEMPO:
        return 60.0 / float(tempo)
    raise ConfigError(
        f"tempo is {tempo!r}: expected quarter notes a minute, a number from {MIN_TEMPO:g} to "
        f"{MAX_TEMPO:g}. Leave it out for the study's own tempo."
    )


def chosen_hands(hands: Any) -> tuple[Hand, ...]:
    """Return the hands that play.

    Raises:
        ConfigError: If `hands` is none of the choices.
    """
    if isinstance(hands, str) and hands in HAND_CHOICES:
        return HAND_CHOICES[hands]
    raise not_among("hands", hands, HAND_CHOICES, "both hands")


def checked_repeats(repeats: Any) -> int:
    """Return how many times a study is played.

    Raises:
        ConfigError: If `repeats` is no whole number, or less than 1.
    """
    if _is_whole(repeats) and repeats >= 1:
        return int(repeats)
    raise ConfigError(
        f"repeats is {repeats!r}: expected a whole number, 1 or more. Leave it out to play the "
        "study once."
    )


def checked_octaves(octaves: Any, highest: int) -> int:
    """Return how many octaves a study climbs.

    Args:
        octaves: What was chosen.
        highest: The highest MIDI pitch of the hands that play, were it one octave.

    Raises:
        ConfigError: If `octaves` is no whole number, less than 1, or leaves the keyboard.
    """
    limit = 1 + (MAX_PITCH - highest) // 12
    if _is_whole(octaves) and 1 <= octaves <= limit:
        return int(octaves)
    raise ConfigError(
        f"octaves is {octaves!r}: expected a whole number from 1 to {limit}, as the keyboard ends "
        "there. Choose fewer, or leave it out."
    )


def not_among(name: str, value: Any, choices: Iterable[str], default: str) -> ConfigError:
    """Return the error that says that an option is none of its choices.

    Args:
        name: The option.
        value: What was chosen.
        choices: What could have been.
        default: What is played if the option is left out.
    """
    known = list(choices)
    return ConfigError(
        f"{name} is {value!r}.{near_names(str(value), known)} Expected one of "
        f"{', '.join(map(repr, known))}. Leave it out for {default}."
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_whole(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)
