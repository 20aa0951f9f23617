"""The user's library: pieces that were imported, kept in a folder of the user's."""

from sb3_piano.music.library.datasets import PIG_PIECES
from sb3_piano.music.library.importing import ImportReport, import_path
from sb3_piano.music.library.piece_file import PieceInfo, read_piece
from sb3_piano.music.library.store import (
    Library,
    imported_pieces,
    piece_features,
)
from sb3_piano.music.library.task import Unusable
from sb3_piano.user_data import DATA_VARIABLE, PIECE_SUFFIX, pieces_folder

__all__ = [
    "DATA_VARIABLE",
    "PIECE_SUFFIX",
    "PIG_PIECES",
    "ImportReport",
    "Library",
    "PieceInfo",
    "Unusable",
    "import_path",
    "imported_pieces",
    "piece_features",
    "pieces_folder",
    "read_piece",
]
