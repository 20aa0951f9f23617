"""``sb3-piano bench``: measure speed and memory."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

from sb3_piano.cli.common import EXIT_INTERRUPTED, EXIT_OK, command, whole_number


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _bench)
    add("--peer-python", "PATH", "also measure RoboPianist: a Python that has it")
    add("--before", "FOLDER", "also measure another version: its checkout")
    add("--rounds", "N", "number of rounds; medians are reported", whole_number, 10)
    parts, only = (
        ("simulation", "players", "learner", "memory"),
        "part to measure; repeatable; default: all",
    )
    add("--only", text=only, action="append", choices=parts)
    add("--num-threads")
    add("--json", text="write the result to a JSON file")
    add("--no-progress")


def _bench(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from sb3_piano.files import write_json
    from sb3_piano.lab.bench import PARTS, render, run_bench

    report = run_bench(
        parts=arguments.only or PARTS,
        rounds=arguments.rounds,
        peer_python=arguments.peer_python,
        before=arguments.before,
        num_threads=arguments.num_threads,
        progress=not arguments.no_progress,
    )
    Console().print(render(report))
    if arguments.json is not None:
        write_json(arguments.json, dataclasses.asdict(report))
        print(f"Result: {arguments.json}")
    return EXIT_INTERRUPTED if report.interrupted else EXIT_OK
