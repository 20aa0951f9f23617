"""Studies: generated pieces."""

from collections.abc import Mapping
from types import MappingProxyType

from sb3_piano.music.piece import Piece
from sb3_piano.music.studies.debug import DEBUG
from sb3_piano.music.studies.hanon import HANON
from sb3_piano.music.studies.scales import ARPEGGIOS, SCALES

STUDIES: Mapping[str, Piece] = MappingProxyType({**DEBUG, **SCALES, **ARPEGGIOS, **HANON})
"""All generated pieces by name."""

__all__ = ["STUDIES"]
