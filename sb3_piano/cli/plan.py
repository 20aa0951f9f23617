"""``sb3-piano plan``: write the plan of a piece, optionally refined in simulation."""

from __future__ import annotations

import argparse
import os
import shlex
import time
from pathlib import Path
from typing import Any

from sb3_piano.cli.common import (
    command,
    print_interrupted,
    whole_number,
)
from sb3_piano.cli.play import SET_HELP, minutes, refine, stage_of
from sb3_piano.exceptions import ConfigError

_REFINE_HELP = (
    "refine the plan in simulation for this time, on all cores; an existing file is refined "
    "further. Ctrl-C stops and keeps the best plan so far"
)


def add_arguments(parser: Any) -> None:
    """Add the arguments of ``plan``."""
    add = command(parser, _plan)
    add("what", "PIECE|ENV_ID", "a piece's name, a file such as MIDI, or an environment id")
    add("--refine", "MINUTES", _REFINE_HELP, minutes)
    add("--passes", "N", "refine the plan by playing it N times", whole_number)
    add("--seed", "N", "random seed of the refinement", int, 0)
    add("--parts", action="append")
    add("--set", "NAME=VALUE", SET_HELP, action="append")
    add("--out", "FILE.npz", "output file; default: play/<title>-planned/plan.npz", Path)
    add("--no-progress")


def _plan(arguments: argparse.Namespace) -> int:
    from sb3_piano.training.playing.takes import plan_file

    if os.path.isdir(arguments.what):
        raise ConfigError(
            f"'{arguments.what}' is a folder: expected a piece or a file. A plan is a file now; "
            "'sb3-piano plan PIECE --refine MINUTES --out FILE.npz' refines it further."
        )
    stage = stage_of(arguments)
    start = time.monotonic()
    file = plan_file(stage) if arguments.out is None else arguments.out
    limited = arguments.refine is not None and arguments.passes is None
    passes = None if limited else arguments.passes or 0
    made, interrupted = refine(stage, file, arguments, passes)
    refined = f", F1 {made.before:.3f} before, {made.f1:.3f} after {made.passes} pass"
    print(
        f"{made.piece}: planned in {time.monotonic() - start:.0f} s"
        + (f"{refined}{'es' * (made.passes != 1)}" if made.passes else f", F1 {made.f1:.3f}")
    )
    what, path = (shlex.quote(str(one)) for one in (arguments.what, file))
    print(f"Plan:        {file}")
    print(f"Watch:       sb3-piano play {what} --player planned:plan={path}")
    print(f"Refine it:   sb3-piano plan {what} --out {path} --refine MINUTES")
    return print_interrupted(interrupted, hint=": the best plan so far is kept.")
