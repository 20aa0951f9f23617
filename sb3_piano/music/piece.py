"""A piece that has a name: what is known about it before its score is made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.music.score import Score


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A piece that :func:`~sb3_piano.music.load_score` and ``gymnasium.make`` know by name.

    Attributes:
        name: Its full name, which starts with the name of its collection and a hyphen if it comes
            with the package: ``"scale-CMajor"``; its id is ``"RoboPianist-scale-CMajor-v0"``.
        title: What people call it: ``"C major scale"``.
        collection: What it belongs to: ``"debug"``, ``"scale"``, ``"repertoire"``...
        source: Where its notes come from, in one line.
        fingering: Who chose the fingers, in a word or two: ``"standard"``, ``"ours"``...
        build: Makes the score; takes the options as keyword arguments.
        options: What may be chosen: the meaning of each option, in one line, by its name.
        composer: Who wrote it, for people; empty where that is not known.
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
        """Return the score.

        Raises:
            ConfigError: If the piece has no such option, or a value is out of range.
            ScoreError: If the score cannot be made, for instance of a damaged file.
        """
        for option in options:
            if option not in self.options:
                raise ConfigError(
                    f"Piece {self.name!r} has no option {option!r}."
                    f"{near_names(option, self.options)} Expected "
                    f"{', '.join(sorted(self.options)) or 'none'}."
                )
        return self.build(**options)
