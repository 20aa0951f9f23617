"""Names that an imported piece cannot have."""

from __future__ import annotations


def is_built_in(name: str) -> bool:
    """Return whether a piece that comes with the package has that name."""
    # The catalogue of built-in pieces would be a circle: it imports this folder.
    from sb3_piano.music.repertoire import REPERTOIRE
    from sb3_piano.music.studies import STUDIES

    return name in STUDIES or name in REPERTOIRE
