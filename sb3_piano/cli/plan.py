"""``sb3-piano plan``: a run that plays without any training, refined in simulation or not."""

from __future__ import annotations

import argparse
import os
import shlex
import time
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    command,
    env_options,
    progress_bar,
    refuse_options,
    tell_interrupted,
)
from sb3_piano.cli.play import PLAYER_OPTIONS, add_player_arguments, player_config
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.training.runs.folder import RunFolder

_SET_HELP = "an option of the environment, such as physics=fast; may be given several times"
_REFINE_HELP = (
    "refine the plan in simulation for so long, on all cores; a run that was refined before goes "
    "on. Ctrl-C ends it and keeps the best plan so far"
)


def add_arguments(parser: Any) -> None:
    """Add the arguments of ``plan``."""
    add = command(parser, _plan)
    what = "a file, such as MIDI, a piece by its name, an environment, or with --refine a run"
    add("what", "PIECE|ENV_ID|RUN", what)
    add("--refine", "MINUTES", _REFINE_HELP, _minutes)
    add_player_arguments(add)
    add("--seed", "N", "what --player sampling and --refine draw from; default: 0", int)
    add("--set", "NAME=VALUE", _SET_HELP, action="append")
    add("--runs-dir")
    add("--out", "DIR", "the run's folder, in place of one in --runs-dir")
    add("--no-progress")


def _minutes(text: str) -> float:
    try:
        minutes = float(text)
    except ValueError:
        minutes = 0.0
    if not 0 < minutes < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of minutes above 0, such as 5")
    return minutes


def _plan(arguments: argparse.Namespace) -> int:
    from sb3_piano.training.playing.takes import plan_run
    from sb3_piano.training.runs.folder import RunFolder

    if os.path.isdir(arguments.what):
        if arguments.refine is None:
            raise ConfigError(
                f"'{arguments.what}' is a folder: expected a piece, or --refine MINUTES to refine "
                "the plan of a run."
            )
        others = (*PLAYER_OPTIONS, "seed", "set", "runs_dir", "out")
        refuse_options(arguments, others, f"with the run '{arguments.what}', which has its own.")
        return _refine(RunFolder.open(arguments.what), arguments)
    options = env_options(arguments.set or ())
    config = player_config(arguments, arguments.seed or 0, options)
    if arguments.refine is not None and config.algo != "planned":
        raise ConfigError(
            f"--refine cannot be given to the player {config.algo!r}: expected none, which is the "
            "planned one."
        )
    run, piece, seconds = plan_run(config, arguments.out, runs_dir=arguments.runs_dir or "runs")
    path = shlex.quote(str(run.path))
    print(f"{piece}: ready to play after {seconds:.1f} s, without any training")
    print(f"Run:         {run.path}")
    print(f"Evaluate:    sb3-piano evaluate {path}")
    print(f"Watch:       sb3-piano play {path}")
    return EXIT_OK if arguments.refine is None else _refine(run, arguments)


def _refine(run: RunFolder, arguments: argparse.Namespace) -> int:
    """Refine the plan of a run, and return the exit status."""
    from sb3_piano.interrupts import stop_on_signal
    from sb3_piano.training.playing.takes import refine_run

    start = time.monotonic()
    with progress_bar(arguments, "Refining") as tell, stop_on_signal() as request:

        def on_step(done: int, total: int, f1: float) -> None:
            tell(description=f"Refining, F1 {f1:.3f}", completed=done, total=total)

        refined = refine_run(
            run, minutes=arguments.refine, on_step=on_step, should_stop=lambda: request.made
        )
    path = shlex.quote(str(run.path))
    print(
        f"Refined:     F1 {refined.before:.3f} before, {refined.f1:.3f} after {refined.passes} "
        f"pass{'es' * (refined.passes != 1)}, {time.monotonic() - start:.0f} s"
    )
    if refined.passes > 0:
        print(f"Plan:        {run.plan_file}")
        print(f"Go on:       sb3-piano plan {path} --refine MINUTES")
    hint = f": the best plan so far is kept. To go on: sb3-piano plan {path} --refine MINUTES"
    return tell_interrupted(request.made, hint=hint)
