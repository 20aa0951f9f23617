"""``sb3-piano report``: an HTML page of what a trained model plays."""

from __future__ import annotations

import argparse
import sys
import webbrowser
from pathlib import Path
from typing import Any

from sb3_piano.cli.common import EXIT_OK, TRUST, check_output_file


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    report = commands.add_parser(
        "report",
        help="write an HTML page: piano roll, fingers, reward, training",
        epilog=TRUST,
    )
    add = report.add_argument
    add("run", metavar="RUN", help="the folder that train made")
    add("--out", type=Path, metavar="FILE.html", help="default: RUN/evaluation/report.html")
    add("--seed", type=int, default=0, metavar="N", help="default: 0")
    add("--physics", metavar="NAME", help="reference or fast; default: what it was trained on")
    add("--best", metavar="METRIC", help="play the best model by f1 or onset_f1, not the last one")
    add("--open", action="store_true", help="open it in the web browser")
    report.set_defaults(command=_report)


def _report(arguments: argparse.Namespace) -> int:
    check_output_file("--out", arguments.out)
    from sb3_piano.training.report import write_report

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
