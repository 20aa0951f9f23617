"""``sb3-piano report`` and ``share``: a run for others, as a page and as plain files."""

from __future__ import annotations

import argparse
import shlex
import sys
import webbrowser
from pathlib import Path
from typing import Any

from sb3_piano.cli.common import EXIT_OK, TRUST, add_command, check_output_file


def add_parser(commands: Any) -> None:
    """Add both commands and their arguments."""
    about = "write an HTML page: piano roll, fingers, reward, training"
    add = add_command(commands, "report", _report, about, epilog=TRUST)
    add("run", "RUN", "the folder that train made")
    add("--out", "FILE.html", "default: RUN/evaluation/report.html", Path)
    add("--seed", "N", "", int, 0)
    add("--physics")
    add("--best")
    add("--open", text="open it in the web browser")
    add = add_command(commands, "share", _share, "write a run for others to play, as plain files")
    add("run", "RUN", "the folder that train made")
    add("folder", "FOLDER", "where to, new or empty")
    add("--best", text="share the best model by f1 or onset_f1, not the last one")


def _report(arguments: argparse.Namespace) -> int:
    check_output_file("--out", arguments.out)
    from sb3_piano.training import write_report

    path = write_report(
        arguments.run,
        arguments.out,
        seed=arguments.seed,
        physics=arguments.physics,
        best=arguments.best,
    )
    print(f"Report: {path}")
    if arguments.open and not webbrowser.open(path.resolve().as_uri()):
        print("No web browser could be started: open the file in one.", file=sys.stderr)
    return EXIT_OK


def _share(arguments: argparse.Namespace) -> int:
    from sb3_piano.training import share

    shared = share(arguments.run, arguments.folder, best=arguments.best)
    print(f"Shared:   {shared.path}")
    print(
        "          no file in it is a pickle; run.yml tells the command and paths of its training"
    )
    print(f"Evaluate: sb3-piano evaluate {shlex.quote(str(shared.path))}")
    return EXIT_OK
