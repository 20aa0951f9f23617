"""``sb3-piano distill``: train a policy for any piece, or resume its training."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    command,
    env_options,
    print_interrupted,
    progress_bar,
    refuse_options,
    whole_number,
)
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.lab.distillation import DistillResult
    from sb3_piano.lab.distillation.rounds import RoundResult

_SET_HELP = (
    "override a setting of the file, such as rounds.0.epochs=3, improvements=[] or "
    "teacher.plan.passes=2; repeatable"
)


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _distill, epilog=TRUST)
    add("--out", "FOLDER", "output folder, new or empty")
    add("--config", text="settings of the distillation; default: the package's file")
    add("--set", "NAME=VALUE", _SET_HELP, action="append")
    add("--resume", "FOLDER", "resume the distillation in this folder")
    add("--workers", "N", "playing processes; default: one per core", whole_number)
    add("--num-threads")
    add("--no-progress")


def _distill(arguments: argparse.Namespace) -> int:
    from sb3_piano.lab.distillation import DEFAULT_FILE, DistillConfig, distill

    folder, resumed = arguments.out, arguments.resume
    if (folder is None) == (resumed is None):
        raise ConfigError("Expected either --out FOLDER or --resume FOLDER.")
    if resumed is not None:
        reason = "with --resume: a distillation keeps its settings."
        instead = "Expected --resume alone, or --out with a new folder."
        refuse_options(arguments, ("config", "set"), reason, instead)
    config = None
    if resumed is None:
        file = DEFAULT_FILE if arguments.config is None else Path(arguments.config)
        config = DistillConfig.from_yaml(file, **env_options(arguments.set or ()))
    with progress_bar(arguments, "excerpts") as tell:
        result = distill(
            config,
            folder if resumed is None else resumed,
            workers=arguments.workers,
            num_threads=arguments.num_threads,
            on_progress=lambda text, done, total: tell(
                description=text, completed=done, total=total
            ),
            on_round=_tell_round,
        )
    return _report(result)


def _tell_round(result: RoundResult) -> None:
    loss = "" if result.loss is None else f", loss {result.loss:.4f}"
    print(
        f"{result.name}: F1 {result.f1:.3f}, onset F1 {result.onset_f1:.3f}{loss}, "
        f"{result.transitions} control steps, {result.minutes:.1f} min",
        flush=True,
    )
    if result.skipped:
        number, why = next(iter(result.skipped.items()))
        print(f"  {len(result.skipped)} excerpts were left out, such as number {number}: {why}")
    unplayed = [title for title, metrics in result.pieces.items() if metrics is None]
    if unplayed:
        print(f"  Unplayable evaluation pieces: {', '.join(unplayed)}")


def _report(result: DistillResult) -> int:
    from sb3_piano.lab.distillation.distill import resume_command

    print(f"Folder:      {result.folder}")
    if result.weights is not None:
        print(f"Weights:     {result.weights}")
        print(f"Play:        sb3-piano play PIECE --player {shlex.quote(str(result.weights))}")
    if result.interrupted:
        print(f"Resume:      {resume_command(result.folder)}")
    return print_interrupted(result.interrupted, EXIT_OK)
