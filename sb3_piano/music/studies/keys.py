"""The twelve keys as the studies name them: ``Db`` major, ``CSharp`` minor."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

MAJOR_SCALE = (0, 2, 4, 5, 7, 9, 11)
"""The seven notes of a major scale, in semitones above its first."""

MAJOR_KEYS: Mapping[str, int] = MappingProxyType(
    {
        name: semitones
        for semitones, name in enumerate(
            ("C", "Db", "D", "Eb", "E", "F", "Gb", "G", "Ab", "A", "Bb", "B")
        )
    }
)
"""Semitones from C up to the first note of each major key, by the name of the key."""

MINOR_KEYS: Mapping[str, int] = MappingProxyType(
    {
        name: semitones
        for semitones, name in enumerate(
            ("C", "CSharp", "D", "Eb", "E", "F", "FSharp", "G", "GSharp", "A", "Bb", "B")
        )
    }
)
"""The same of each minor key."""


def spoken(key: str) -> str:
    """Return the name of a key as it is read: ``"B flat"``, ``"C sharp"``."""
    return f"{key[0]}{key[1:].replace('Sharp', ' sharp').replace('b', ' flat')}"
