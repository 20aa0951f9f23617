"""``sb3-piano export``: a run for others to play, or the files of the page in the browser."""

from __future__ import annotations

import argparse
import shlex
from typing import Any

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    command,
    progress_bar,
    refuse_options,
    tell_errors,
    whole_number,
)

_WEB = "web"
_PIECES_HELP = (
    "names, files, patterns, collections or lists of pieces; default: the repertoire, a scale and "
    "an exercise"
)
_TREE_HELP = (
    "let the sight-reader look ahead where it is recorded, N simulations of up to D control steps, "
    "such as 64x8; takes some minutes a piece"
)


_OF_WEB = ("pieces", "tree")
_OF_RUNS = ("best", "episodes", "no_video", "onnx", "push_to_hub")


def add_arguments(parser: Any) -> None:
    """Add the arguments of ``export``."""
    add = command(parser, _export, epilog=TRUST)
    add("what", "RUN|web", "a run's folder; or web: scene, hands, network and pieces, played")
    add("folder", "FOLDER", "where to, of a run new or empty, of web such as web/assets")
    add("--best", text="of a run: the best model by f1 or onset_f1, not the last one")
    add("--episodes", "N", "that the card of a run tells of; default: 5", whole_number)
    add("--no-video", text="of a run: without replay.mp4")
    add("--onnx", text="of a run: the actor as policy.onnx, too")
    add("--push-to-hub", "REPO", "publish the folder as OWNER/NAME on the Hugging Face Hub, too")
    add("--pieces", "PIECE", f"of web: {_PIECES_HELP}", nargs="+")
    add("--tree", text=f"of web: {_TREE_HELP}")
    add("--no-progress")


def _export(arguments: argparse.Namespace) -> int:
    if arguments.what == _WEB:
        refuse_options(arguments, _OF_RUNS, "with web:", "expected it with a run's folder.")
        return _export_web(arguments)
    refuse_options(arguments, _OF_WEB, "with a run:", "expected it with web.")
    return _export_run(arguments)


def _export_run(arguments: argparse.Namespace) -> int:
    from sb3_piano.training import RunFolder, export_run
    from sb3_piano.training.evaluation.evaluate import pieces_of
    from sb3_piano.training.sharing.hub import push_to_hub
    from sb3_piano.viewing import DEFAULT_PICTURE

    count = arguments.episodes or 5
    with progress_bar(arguments, "Episodes") as tell:
        tell(total=count * len(pieces_of(RunFolder.open(arguments.what))))
        exported = export_run(
            arguments.what,
            arguments.folder,
            best=arguments.best,
            episodes=count,
            picture=None if arguments.no_video else DEFAULT_PICTURE,
            onnx=arguments.onnx,
            on_episode=lambda: tell(advance=1),
            progress=lambda done, total: tell(description="Video", completed=done, total=total),
        )
    print(f"Exported: {exported.path}")
    print("          no file in it is a pickle; run.yml and README.md tell how it was trained")
    print(f"Evaluate: sb3-piano evaluate {shlex.quote(str(exported.path))}")
    if arguments.push_to_hub is not None:
        print(f"Hub:      {push_to_hub(exported, arguments.push_to_hub)}")
    if not arguments.no_video and not exported.video_file.is_file():
        return tell_errors("There is no video: the run is of no piano, or nothing can draw here.")
    return EXIT_OK


def _export_web(arguments: argparse.Namespace) -> int:
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
