"""A named piece: its description, and how to make its score."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.music.score import Score


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A piece with a name for :func:`~sb3_piano.music.load_score` and ``gymnasium.make``.

    Attributes:
        name: Its full name. That of a built-in piece starts with its collection and a hyphen:
            ``"scale-CMajor"``; its id is ``"RoboPianist-scale-CMajor-v0"``.
        title: Its readable title: ``"C major scale"``.
        collection: Its collection: ``"debug"``, ``"scale"``, ``"repertoire"``...
        source: Source of its notes, in one line.
        fingering: Source of its fingering, in a word or two: ``"standard"``, ``"ours"``...
        build: Function that makes the score; takes the options as keyword arguments.
        options: The meaning of each option, in one line, by the option's name.
        composer: The composer's readable name; empty if unknown.
    """

    name: str
    title: str
    collection: str
    source: str
    fingering: str
    build: Callable[..., Score]
    options: Mapping[str, str] = field(default_factory=dict)
    composer: str = ""

    def score(self, **options: Any) -> Score:
        """Make the score.

        Raises:
            ConfigError: If the piece has no such option, or a value is out of range.
            ScoreError: If the score cannot be made, for instance from a damaged file.
        """
        for option in options:
            if option not in self.options:
                raise ConfigError(
                    f"Piece {self.name!r} has no option {option!r}."
                    f"{near_names(option, self.options)} Expected "
                    f"{', '.join(sorted(self.options)) or 'none'}."
                )
        return self.build(**options)
