"""The user's library: imported pieces in a folder of the user's."""

from sb3_piano.music.library.importing import import_path
from sb3_piano.music.library.store import Library, imported_pieces

__all__ = ["Library", "import_path", "imported_pieces"]
