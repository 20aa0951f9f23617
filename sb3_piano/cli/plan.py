"""``sb3-piano plan``, and ``play --planned``: hands that play without any training."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import EXIT_OK, add_shared, env_options, progress_bar, whole_number
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.training import PlannedConfig
    from sb3_piano.viewing import Take

_PLANNER_OPTIONS = ("rehearsals", "sampling", "nominal", "horizon", "reduced")
_OF_SAMPLING = ("nominal", "horizon")


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    plan = commands.add_parser("plan", help="make a run that plays without any training")
    add = plan.add_argument
    what_help = "a file, such as MIDI, a piece by its name, or an environment"
    add("what", metavar="PIECE|ENV_ID", help=what_help)
    add_planner_arguments(add)
    add("--seed", type=int, default=0, metavar="N", help="what sampling draws from; default: 0")
    add_shared(add, "--set")
    add_shared(add, "--runs-dir", default="runs")
    add("--out", metavar="DIR", help="the run's folder, in place of one in --runs-dir")
    plan.set_defaults(command=_plan)


def add_planner_arguments(add: Callable[..., Any]) -> None:
    """Add what ``plan`` and ``play --planned`` take: who plays, and with which joints."""
    add(
        "--rehearsals",
        type=whole_number,
        metavar="N",
        help="play the plan N times in a simulation first, and try otherwise what goes wrong",
    )
    add(
        "--sampling",
        type=whole_number,
        metavar="N",
        help="let predictive sampling try N ways on from each control step, and play the best",
    )
    add(
        "--nominal",
        metavar="WHAT",
        help="what these ways change: plan (default), or none for sampling from zero",
    )
    add("--horizon", type=whole_number, metavar="H", help="control steps that sampling looks ahead")
    add("--reduced", action="store_true", help="the reduced action space, not all joints")


def _plan(arguments: argparse.Namespace) -> int:
    from sb3_piano.training.playing.takes import plan_run

    config = _config(arguments, arguments.seed, env_options(arguments.set))
    folder, piece, seconds = plan_run(config, arguments.out, runs_dir=arguments.runs_dir)
    path = shlex.quote(str(folder.path))
    print(f"{piece}: ready to play after {seconds:.1f} s, without any training")
    print(f"Run:         {folder.path}")
    print(f"Evaluate:    sb3-piano evaluate {path}")
    print(f"Watch:       sb3-piano play {path}")
    return EXIT_OK


def check_planned(arguments: argparse.Namespace) -> None:
    """Refuse arguments of planners without ``--planned``, and ``--planned`` with a run.

    Raises:
        ConfigError: If there are such.
    """
    what = arguments.what
    if not arguments.planned:
        for name in _PLANNER_OPTIONS:
            if getattr(arguments, name) not in (None, False):
                raise ConfigError(
                    f"--{name} cannot be given without --planned: expected --planned, too, and a "
                    "piece."
                )
    elif Path(what).is_dir():
        raise ConfigError(
            f"--planned cannot be given with the run '{what}': its own model plays. Expected a "
            "piece, or no --planned."
        )


def planned_take(arguments: argparse.Namespace) -> tuple[Take, Path]:
    """Let planned hands play a piece, say how well, and return that and the folder for it."""
    from sb3_piano.training.playing.takes import default_folder, take_of_planner

    physics = arguments.physics
    options = {} if physics is None else {"physics": physics}
    config = _config(arguments, arguments.seed or 0, options)
    with progress_bar(arguments, "Planning") as tell:

        def on_step(done: int, total: int) -> None:
            if done:
                tell(description="Playing", completed=done, total=total)
            else:
                tell()

        played = take_of_planner(config, on_step)
    metrics, roll = played.metrics, played.take.performance.roll
    print(
        f"F1 {metrics['f1']:.3f} (precision {metrics['precision']:.3f}, recall "
        f"{metrics['recall']:.3f}; playing nothing {metrics['noop_f1']:.3f}), onset F1 "
        f"{metrics['onset_f1']:.3f}"
    )
    print(
        f"Planned in {played.planning:.1f} s, {len(roll) * roll.control_timestep:.1f} s of music "
        f"played in {played.playing:.1f} s"
    )
    own = default_folder(None, played.score)
    folder = own.with_name(f"{own.name}-{config.algo}")
    return played.take, folder if arguments.out is None else Path(arguments.out)


def _config(arguments: argparse.Namespace, seed: int, options: dict[str, Any]) -> PlannedConfig:
    """Return the settings of the player that the arguments stand for.

    Raises:
        ConfigError: If they do not fit together, or one is not valid.
    """
    from sb3_piano.training.playing.takes import planner_config

    if arguments.reduced:
        options["reduced_action_space"] = True
    given = {n: value for n in _OF_SAMPLING if (value := getattr(arguments, n)) is not None}
    plan = {} if arguments.rehearsals is None else {"rehearsals": arguments.rehearsals}
    if arguments.sampling is None:
        for name in given:
            raise ConfigError(
                f"--{name} cannot be given without --sampling: a plan is followed as it is. "
                "Expected --sampling N, too."
            )
        algo, given = "planned", {"settings": plan} if plan else {}
    else:
        if plan and arguments.nominal == "none":
            raise ConfigError(
                "--rehearsals cannot be given with --nominal none: there is no plan to rehearse. "
                "Expected one of them."
            )
        algo, given["samples"] = "sampling", arguments.sampling
        given |= {"plan_settings": plan} if plan else {}
    return planner_config(arguments.what, algo, seed=seed, env_kwargs=options, **given)
