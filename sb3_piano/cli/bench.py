"""``sb3-piano bench``: measure speed and memory."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from sb3_piano.cli.common import (
    EXIT_INTERRUPTED,
    EXIT_OK,
    NUM_THREADS_HELP,
    check_output_file,
    whole_number,
)


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    bench = commands.add_parser("bench", help="measure speed and memory")
    add = bench.add_argument
    add("--peer-python", metavar="PATH", help="measure RoboPianist too: a Python that has it")
    add("--before", metavar="FOLDER", help="measure another version too: a checkout's folder")
    add(
        "--rounds",
        type=whole_number,
        default=10,
        metavar="N",
        help="rounds to take medians of; default: 10",
    )
    add(
        "--only",
        action="append",
        choices=("simulation", "learner", "memory"),
        help="measure this part; may be given several times",
    )
    add("--num-threads", type=whole_number, metavar="N", help=NUM_THREADS_HELP)
    add("--json", type=Path, metavar="FILE", help="write the result to a file as well")
    add("--no-progress", action="store_true", help="show no progress bar")
    bench.set_defaults(command=_bench)


def _bench(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from sb3_piano.bench import PARTS, render, run_bench
    from sb3_piano.files import write_json

    file: Path | None = arguments.json
    check_output_file("--json", file)
    report = run_bench(
        parts=arguments.only or PARTS,
        rounds=arguments.rounds,
        peer_python=arguments.peer_python,
        before=arguments.before,
        num_threads=arguments.num_threads,
        progress=not arguments.no_progress,
    )
    Console().print(render(report))
    if file is not None:
        write_json(file, dataclasses.asdict(report))
        print(f"Result: {file}")
    return EXIT_INTERRUPTED if report.interrupted else EXIT_OK
