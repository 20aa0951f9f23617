"""``sb3-piano evaluate``: let trained models play, and say how well they do."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_ERROR,
    EXIT_INTERRUPTED,
    EXIT_OK,
    TRUST,
    check_output_file,
    print_narrowness,
    whole_number,
)
from sb3_piano.cli.metric_names import check_metric_names

if TYPE_CHECKING:
    from sb3_piano.training import Evaluation, Evaluations

_MOST_FILES_LISTED = 5
_REPETITION = (
    "all episodes are the same: nothing is random, so one would do, and there is no interval."
)


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    evaluate = commands.add_parser("evaluate", help="let trained models play", epilog=TRUST)
    add = evaluate.add_argument
    add("runs", nargs="+", metavar="RUN", help="a folder that train made; several are compared")
    add("--episodes", type=whole_number, default=1, metavar="N", help="of each seed; default: 1")
    seeds = evaluate.add_mutually_exclusive_group()
    seeds.add_argument("--seed", type=int, default=0, metavar="N", help="default: 0")
    seeds.add_argument("--seeds", type=int, nargs="+", metavar="N", help="several, in its place")
    add(
        "--score",
        action="append",
        default=[],
        metavar="PIECE",
        help="a file, such as MIDI, or a piece's name, to be played in place of each run's own "
        "piece; may be given several times",
    )
    add("--physics", metavar="NAME", help="reference or fast; default: what it was trained on")
    add("--best", metavar="METRIC", help="play the best model by f1 or onset_f1, not the last one")
    add(
        "--motion",
        action="store_true",
        help="also write how everything moved, as performance_<i>.npz beside each MIDI file",
    )
    add("--metrics", nargs="+", metavar="NAME", help="show these, such as f1 onset_f1 return")
    add("--csv", type=Path, metavar="FILE", help="write a row for each episode")
    add("--json", type=Path, metavar="FILE", help="write everything, statistics included")
    add("--no-progress", action="store_true", help="show no progress bar")
    evaluate.set_defaults(command=_evaluate)


def evaluate_run(run: str, episodes: int, seed: int) -> None:
    """Evaluate a run and print what was found."""
    from sb3_piano.training import evaluate

    _show_one(evaluate(run, episodes, seed))


def _evaluate(arguments: argparse.Namespace) -> int:
    check_metric_names(arguments.metrics or [])
    for option in ("csv", "json"):
        check_output_file(f"--{option}", getattr(arguments, option))
    from sb3_piano.training import evaluate_runs

    seeds = [arguments.seed] if arguments.seeds is None else arguments.seeds
    with _progress(arguments, arguments.episodes * len(seeds)) as on_episode:
        found = evaluate_runs(
            arguments.runs,
            arguments.episodes,
            seeds,
            physics=arguments.physics,
            scores=arguments.score,
            best=arguments.best,
            motion=arguments.motion,
            on_episode=on_episode,
        )
    if found.evaluations:
        _show(found, arguments.metrics)
        _write(found, arguments.csv, arguments.json)
    for failure in found.failures:
        print(f"sb3-piano: error: {failure}", file=sys.stderr)
    if found.interrupted:
        print("sb3-piano: interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return EXIT_ERROR if found.failures else EXIT_OK


@contextlib.contextmanager
def _progress(arguments: argparse.Namespace, each: int) -> Iterator[Callable[[], object]]:
    """Show a bar on a terminal's standard error, if several runs or pieces are evaluated.

    Args:
        arguments: The command's.
        each: Episodes of each run and piece.
    """
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress

    console = Console(stderr=True)
    count = len(arguments.runs) * max(len(arguments.score), 1)
    if arguments.no_progress or count == 1 or not console.is_terminal:
        yield lambda: None
        return
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("episodes", total=each * count)
        yield lambda: progress.advance(task)


def _show(found: Evaluations, metrics: list[str] | None) -> None:
    first, *others = found.evaluations
    if not others and not found.failures:
        _show_one(first, metrics)
        return
    from rich.console import Console

    from sb3_piano.cli.evaluation_tables import common_parent, several_runs_tables
    from sb3_piano.training import MAIN_METRICS

    parent = common_parent(found.evaluations)
    if str(parent) != ".":
        print(f"Runs in {parent}")
    known = [n for n in MAIN_METRICS if any(n in e.summary for e in found.evaluations)]
    for table in several_runs_tables(found.evaluations, metrics or known):
        Console().print(table)
    if any(_has_interval(evaluation) for evaluation in found.evaluations):
        print("Means over all episodes of all seeds; below, where they vary, 95 % intervals.")
        print_narrowness(min(map(_n_episodes, filter(_has_interval, found.evaluations))))
    repeated = [evaluation for evaluation in found.evaluations if evaluation.is_repetition]
    if repeated:
        print(f"In {len(repeated)} of {len(found.evaluations)} rows {_REPETITION}")


def _has_interval(evaluation: Evaluation) -> bool:
    return any(summary.interval is not None for summary in evaluation.summary.values())


def _n_episodes(evaluation: Evaluation) -> int:
    return len(evaluation.episodes)


def _show_one(evaluation: Evaluation, metrics: list[str] | None = None) -> None:
    from rich.console import Console

    from sb3_piano.cli.evaluation_tables import one_run_table

    n_episodes = len(evaluation.episodes)
    plural = "episode" if n_episodes == 1 else "episodes"
    print(
        f"{evaluation.piece}: {n_episodes} {plural}, model after {evaluation.num_timesteps} steps "
        "of training"
    )
    Console().print(one_run_table(evaluation, metrics))
    if _has_interval(evaluation):
        print_narrowness(n_episodes)
    if evaluation.is_repetition:
        print(f"Here {_REPETITION}")
    if evaluation.metrics_file is not None:
        _list_performances(evaluation)
        print(f"Metrics:     {evaluation.metrics_file}")


def _list_performances(evaluation: Evaluation) -> None:
    if evaluation.baseline is None:
        return
    written = [path for path in evaluation.performances if path is not None]
    for path in written[:_MOST_FILES_LISTED]:
        print(f"Performance: {path}")
    if len(written) > _MOST_FILES_LISTED:
        print(f"             and {len(written) - _MOST_FILES_LISTED} more")
    n_silent = len(evaluation.performances) - len(written)
    if n_silent > 0:
        print(
            f"Performance: no key was pressed in {n_silent} of {len(evaluation.performances)} "
            "episodes, so there is no MIDI file"
        )
    if evaluation.motions:
        first, *others = evaluation.motions
        more = f" and {len(others)} more" if others else ""
        print(f"Motion:      {first}{more}")


def _write(found: Evaluations, csv: Path | None, json: Path | None) -> None:
    if csv is not None:
        found.write_csv(csv)
        print(f"Episodes:    {csv}")
    if json is not None:
        found.write_json(json)
        print(f"Everything:  {json}")
