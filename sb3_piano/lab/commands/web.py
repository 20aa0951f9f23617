"""``sb3-piano export``: export a run, or the files of the web page."""

from __future__ import annotations

import argparse
from typing import Any

from sb3_piano.cli.common import EXIT_OK, TRUST, command, progress_bar, refuse_options
from sb3_piano.cli.export import RUN_OPTIONS, add_run_arguments, export_run_folder

_WEB = "web"
_WEB_OPTIONS = ("pieces", "tree", "take", "run")
_PIECES_HELP = (
    "pieces to play: names, files, patterns, collections or lists; default: the repertoire, a "
    "scale and an exercise"
)
_TREE_HELP = (
    "also record the sight-reader with a tree search: N simulations of up to D control steps, such "
    "as 64x8; takes some minutes per piece"
)
_TAKE_HELP = (
    "takes (performance.npz, or folders of such files): those of the pieces are played as their "
    "recordings if they are the best, others are added"
)
_RUN_HELP = "add the recording of a run, which plays its own piece; may be repeated"


def add_arguments(parser: Any) -> None:
    """Add the arguments of ``export``."""
    add = command(parser, _export, epilog=TRUST)
    add("what", "RUN|web", "a run's folder; or web: scene, hands, network and performances")
    add("folder", "FOLDER", "output folder: for a run new or empty; for web such as web/assets")
    add_run_arguments(add)
    add("--pieces", "PIECE", f"of web: {_PIECES_HELP}", nargs="+")
    add("--tree", text=f"of web: {_TREE_HELP}")
    add("--take", "FILE|DIR", f"of web: {_TAKE_HELP}", nargs="+")
    add("--run", "RUN", f"of web: {_RUN_HELP}", action="append")
    add("--no-progress")


def _export(arguments: argparse.Namespace) -> int:
    if arguments.what == _WEB:
        refuse_options(arguments, RUN_OPTIONS, "with web:", "expected it with a run's folder.")
        return _export_web(arguments)
    refuse_options(arguments, _WEB_OPTIONS, "with a run:", "expected it with web.")
    return export_run_folder(arguments)


def _export_web(arguments: argparse.Namespace) -> int:
    from sb3_piano.lab.web import DEFAULT_PIECES, export_web
    from sb3_piano.players import TreeSettings

    tree = None if arguments.tree is None else TreeSettings.parse(arguments.tree)
    with progress_bar(arguments, "performances") as tell:
        path = export_web(
            arguments.folder,
            arguments.pieces or DEFAULT_PIECES,
            tree=tree,
            takes=arguments.take or (),
            runs=arguments.run or (),
            progress=lambda piece, done, total: tell(
                description=piece or "done", completed=done, total=total
            ),
        )
    print(f"Catalogue: {path}")
    return EXIT_OK
