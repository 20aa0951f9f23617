"""``sb3-piano share``: write a run for others to play, without pickles."""

from __future__ import annotations

import argparse
import shlex
from typing import Any

from sb3_piano.cli.common import EXIT_OK


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    share = commands.add_parser("share", help="write a run for others to play, as plain files")
    add = share.add_argument
    add("run", metavar="RUN", help="the folder that train made")
    add("folder", metavar="FOLDER", help="where to, new or empty")
    add("--best", metavar="METRIC", help="share the best model by f1 or onset_f1, not the last one")
    share.set_defaults(command=_share)


def _share(arguments: argparse.Namespace) -> int:
    from sb3_piano.training import share

    shared = share(arguments.run, arguments.folder, best=arguments.best)
    print(f"Shared:   {shared.path}")
    print(
        "          no file in it is a pickle; run.yml tells the command and paths of its training"
    )
    print(f"Evaluate: sb3-piano evaluate {shlex.quote(str(shared.path))}")
    return EXIT_OK
