"""``sb3-piano pieces``: the pieces that come with the package, and the user's own."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sb3_piano.cli import fingering, piece_import, piece_list, piece_show, rank
from sb3_piano.cli.common import EXIT_OK, check_output_file
from sb3_piano.exceptions import ConfigError, UnknownPieceError


def add_parser(commands: Any) -> None:
    """Add the command, whose own commands each have a module, but for the short ones."""
    pieces = commands.add_parser("pieces", help="import, list, show, rank and export pieces")
    own = pieces.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for module in (piece_list, piece_show, piece_import):
        module.add_parser(own)
    remove = own.add_parser("remove", help="remove imported pieces, without asking")
    remove.add_argument("names", nargs="+", metavar="NAME", help="as 'pieces list' shows it")
    remove.set_defaults(command=_remove)
    export = own.add_parser("export", help="write a piece to a file")
    export.add_argument("name", metavar="NAME", help="as 'pieces list' shows it")
    export.add_argument("file", type=Path, metavar="FILE", help="MIDI, MusicXML or PIG, by suffix")
    export.set_defaults(command=_export)
    for module in (rank, fingering):
        module.add_parser(own)


def _remove(arguments: argparse.Namespace) -> int:
    from sb3_piano.exceptions import near_names
    from sb3_piano.music import BUILT_IN
    from sb3_piano.music.library import user_library

    library = user_library()
    for name in arguments.names:  # all of them before the first is gone
        if name in BUILT_IN:
            raise ConfigError(
                f"Piece {name!r} comes with the package: expected pieces that were imported."
            )
        if name not in library:
            raise UnknownPieceError(
                f"No imported piece is named {name!r}.{near_names(name, library.names())} Expected "
                "a name from 'sb3-piano pieces list'."
            )
    for name in dict.fromkeys(arguments.names):
        library.remove(name)
        print(f"Removed: {name}")
    return EXIT_OK


def _export(arguments: argparse.Namespace) -> int:
    check_output_file("FILE", arguments.file)
    from sb3_piano.music import find_piece
    from sb3_piano.music.formats import write_score

    write_score(find_piece(arguments.name).score(), arguments.file)
    print(f"Exported: {arguments.file}")
    return EXIT_OK
