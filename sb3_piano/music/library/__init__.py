"""The user's library: pieces that were imported, kept in a folder of the user's."""

from sb3_piano.music.library.folder import DATA_VARIABLE, data_folder, pieces_folder
from sb3_piano.music.library.imported import imported_pieces, user_library
from sb3_piano.music.library.importing import ImportReport, import_path
from sb3_piano.music.library.piece_file import SUFFIX as PIECE_SUFFIX
from sb3_piano.music.library.piece_file import PieceInfo, read_piece
from sb3_piano.music.library.pig_pieces import PIG_PIECES
from sb3_piano.music.library.search import Unusable
from sb3_piano.music.library.store import Library

__all__ = [
    "DATA_VARIABLE",
    "PIECE_SUFFIX",
    "PIG_PIECES",
    "ImportReport",
    "Library",
    "PieceInfo",
    "Unusable",
    "data_folder",
    "import_path",
    "imported_pieces",
    "pieces_folder",
    "read_piece",
    "user_library",
]
