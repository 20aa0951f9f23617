"""``sb3-piano plan``: make a run that plays without any training."""

from __future__ import annotations

import argparse
import shlex
from typing import Any

from sb3_piano.cli.common import EXIT_OK, env_options
from sb3_piano.cli.planner_arguments import add_planner_arguments, planner_settings


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    plan = commands.add_parser("plan", help="make a run that plays without any training")
    add = plan.add_argument
    add(
        "what",
        metavar="PIECE|ENV_ID",
        help="a file, such as MIDI, a piece by its name, or an environment",
    )
    add_planner_arguments(add)
    add("--seed", type=int, default=0, metavar="N", help="what sampling draws from; default: 0")
    add(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="an option of the environment, such as physics=fast; may be given several times",
    )
    add("--runs-dir", default="runs", metavar="DIR", help="where runs are kept; default: runs")
    add("--out", metavar="DIR", help="the run's folder, in place of one in --runs-dir")
    plan.set_defaults(command=_plan)


def _plan(arguments: argparse.Namespace) -> int:
    from sb3_piano.training.planned import plan_run

    config = planner_settings(
        arguments, arguments.what, seed=arguments.seed, env_kwargs=env_options(arguments.set)
    )
    made = plan_run(config, arguments.out, runs_dir=arguments.runs_dir)
    path = shlex.quote(str(made.folder.path))
    print(f"{made.piece}: ready to play after {made.planning:.1f} s, without any training")
    print(f"Run:         {made.folder.path}")
    print(f"Evaluate:    sb3-piano evaluate {path}")
    print(f"Watch:       sb3-piano play {path}")
    return EXIT_OK
