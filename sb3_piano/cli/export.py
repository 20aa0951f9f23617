"""``sb3-piano export``: what programs elsewhere need of this package."""

from __future__ import annotations

import argparse
from typing import Any

from sb3_piano.cli.common import EXIT_OK, add_command, progress_bar

_PIECES_HELP = (
    "names, files, patterns, collections or lists of pieces; default: the repertoire, a scale and "
    "an exercise"
)
_TREE_HELP = (
    "let the sight-reader look ahead where it is recorded, N simulations of up to D control steps, "
    "such as 64x8; takes some minutes a piece"
)


def add_parser(commands: Any) -> None:
    """Add ``export`` and its arguments."""
    add = add_command(commands, "export", _export, "write the files of the page in the browser")
    add("what", "web", "what is written: scene, hands, network and pieces, played", choices=["web"])
    add("folder", "FOLDER", "where to, such as web/assets")
    add("--pieces", "PIECE", _PIECES_HELP, nargs="+")
    add("--tree", text=_TREE_HELP)
    add("--no-progress")


def _export(arguments: argparse.Namespace) -> int:
    from sb3_piano.players import TreeSettings
    from sb3_piano.web import DEFAULT_PIECES, export_web

    tree = None if arguments.tree is None else TreeSettings.parse(arguments.tree)
    with progress_bar(arguments, "performances") as tell:
        path = export_web(
            arguments.folder,
            arguments.pieces or DEFAULT_PIECES,
            tree=tree,
            progress=lambda piece, done, total: tell(
                description=piece or "done", completed=done, total=total
            ),
        )
    print(f"Catalogue: {path}")
    return EXIT_OK
