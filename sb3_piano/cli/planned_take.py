"""What ``sb3-piano play --planned`` plays, and tells about it."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from sb3_piano.cli.planner_arguments import PLANNER_OPTIONS, planner_settings
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.training.planned import PlannedTake
    from sb3_piano.viewing import Progress, Take


def check_planned(arguments: argparse.Namespace) -> None:
    """Refuse arguments of planners without ``--planned``, and ``--planned`` with a run.

    Raises:
        ConfigError: If there are such.
    """
    what = arguments.what
    if not arguments.planned:
        for name in PLANNER_OPTIONS:
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
    from sb3_piano.training.planned import take_of_planner
    from sb3_piano.training.play import default_folder

    physics = arguments.physics
    config = planner_settings(
        arguments,
        arguments.what,
        seed=arguments.seed or 0,
        env_kwargs={} if physics is None else {"physics": physics},
    )
    with _steps_bar(not arguments.no_progress) as on_step:
        played = take_of_planner(config, on_step)
    _report_planned(played)
    own = default_folder(None, played.score)
    folder = own.with_name(f"{own.name}-{config.algo}")
    return played.take, folder if arguments.out is None else Path(arguments.out)


def _report_planned(played: PlannedTake) -> None:
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


@contextlib.contextmanager
def _steps_bar(wanted: bool) -> Iterator[Progress]:
    """Show on a terminal's standard error that planning is under way, then how far playing is."""
    from rich.console import Console
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    if not (wanted and console.is_terminal):
        yield lambda done, total: None
        return
    with Bar(console=console, transient=True) as bar:
        task = bar.add_task("Planning", total=None)

        def tell(done: int, total: int) -> None:
            if done > 0:
                bar.update(task, description="Playing", completed=done, total=total)

        yield tell
