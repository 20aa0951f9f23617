"""The built-in repertoire: public-domain music with finger labels."""

from collections.abc import Mapping
from types import MappingProxyType

from sb3_piano.music.piece import Piece

REPERTOIRE: Mapping[str, Piece] = MappingProxyType({})
"""The pieces by name."""

__all__ = ["REPERTOIRE"]
