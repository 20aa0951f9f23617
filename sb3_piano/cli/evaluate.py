"""``sb3-piano evaluate``: let trained models play, and say how well they do."""

from __future__ import annotations

import argparse
import itertools
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_ERROR,
    EXIT_INTERRUPTED,
    EXIT_OK,
    TRUST,
    add_row,
    add_shared,
    check_output_file,
    new_table,
    print_narrowness,
    progress_bar,
    whole_number,
)
from sb3_piano.metrics import DEFINITIONS, FINGER_SHARES, Definition, has_value

if TYPE_CHECKING:
    from rich.table import Table

    from sb3_piano.training import Evaluation, Evaluations

_MOST_FILES_LISTED = 5
_REPETITION = (
    "all episodes are the same: nothing is random, so one would do, and there is no interval."
)
_NOTHING = "-"
_SHARES = {
    "shares, right thumb to little": FINGER_SHARES[:5],
    "shares, left thumb to little": FINGER_SHARES[5:],
}
_METRICS_IN_TABLE = 5
"""As many as fit beside each other on most terminals."""


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
    add_shared(add, "--physics")
    add_shared(add, "--best")
    motion_help = "also write how everything moved, as performance_<i>.npz beside each MIDI file"
    add("--motion", action="store_true", help=motion_help)
    add("--metrics", nargs="+", metavar="NAME", help="show these, such as f1 onset_f1 return")
    add_shared(add, "--csv", help="write a row for each episode")
    add_shared(add, "--json")
    add_shared(add, "--no-progress")
    evaluate.set_defaults(command=_evaluate)


def evaluate_run(run: str) -> None:
    """Evaluate a run and print what was found."""
    from sb3_piano.training import evaluate

    _show_one(evaluate(run))


def label(name: str) -> str:
    """Return what a metric is called where it stands alone; one from elsewhere by its name."""
    known = _definition(name)
    return _with_unit(known.label, known.unit)


def rounded(name: str, value: float) -> str:
    """Return the value of a metric with its number of decimals."""
    return _definition(name).rounded(value)


def _definition(name: str) -> Definition:
    return DEFINITIONS.get(name, Definition(name, "", name, "", name))


def _with_unit(text: str, unit: str) -> str:
    if unit.startswith("/"):
        return text + unit
    return f"{text}, {unit}" if unit else text


def _evaluate(arguments: argparse.Namespace) -> int:
    from sb3_piano.settings import refuse_unknown

    refuse_unknown(arguments.metrics or [], DEFINITIONS, "metric")
    for option in ("csv", "json"):
        check_output_file(f"--{option}", getattr(arguments, option))
    from sb3_piano.training import evaluate_runs

    seeds = [arguments.seed] if arguments.seeds is None else arguments.seeds
    count = len(arguments.runs) * max(len(arguments.score), 1)
    arguments.no_progress |= count == 1
    with progress_bar(arguments, "episodes") as tell:
        tell(total=count * arguments.episodes * len(seeds))
        found = evaluate_runs(
            arguments.runs,
            arguments.episodes,
            seeds,
            physics=arguments.physics,
            scores=arguments.score,
            best=arguments.best,
            motion=arguments.motion,
            on_episode=lambda: tell(advance=1),
        )
    if found.evaluations:
        _show(found, arguments.metrics)
        if arguments.csv is not None:
            found.write_csv(arguments.csv)
            print(f"Episodes:    {arguments.csv}")
        if arguments.json is not None:
            found.write_json(arguments.json)
            print(f"Everything:  {arguments.json}")
    for failure in found.failures:
        print(f"sb3-piano: error: {failure}", file=sys.stderr)
    if found.interrupted:
        print("sb3-piano: interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return EXIT_ERROR if found.failures else EXIT_OK


def _show(found: Evaluations, metrics: list[str] | None) -> None:
    first, *others = found.evaluations
    if not others and not found.failures:
        _show_one(first, metrics)
        return
    from rich.console import Console

    from sb3_piano.training import MAIN_METRICS

    parent = _common_parent(found.evaluations)
    if str(parent) != ".":
        print(f"Runs in {parent}")
    known = [n for n in MAIN_METRICS if any(n in e.summary for e in found.evaluations)]
    names = metrics or known
    for start in range(0, len(names), _METRICS_IN_TABLE):
        shown = names[start : start + _METRICS_IN_TABLE]
        Console().print(_several_runs_table(found.evaluations, shown, parent))
    varying = [len(found.episodes) for found in found.evaluations if found.has_interval]
    if varying:
        print("Means over all episodes of all seeds; below, where they vary, 95 % intervals.")
        print_narrowness(min(varying))
    n_repeated = sum(evaluation.is_repetition for evaluation in found.evaluations)
    if n_repeated:
        print(f"In {n_repeated} of {len(found.evaluations)} rows {_REPETITION}")


def _show_one(evaluation: Evaluation, metrics: list[str] | None = None) -> None:
    from rich.console import Console

    n_episodes = len(evaluation.episodes)
    plural = "episode" if n_episodes == 1 else "episodes"
    print(
        f"{evaluation.piece}: {n_episodes} {plural}, model after {evaluation.num_timesteps} steps "
        "of training"
    )
    Console().print(_one_run_table(evaluation, metrics))
    if evaluation.has_interval:
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


def _one_run_table(evaluation: Evaluation, metrics: Sequence[str] | None) -> Table:
    """Return all metrics of one evaluation, or the named ones, by section."""
    several, intervals = len(evaluation.episodes) > 1, evaluation.has_interval
    baseline = evaluation.baseline
    headings = ["metric", "policy (mean ± std)" if several else "policy"]
    headings += ["95 % interval"] * intervals + ["no-op baseline"] * (baseline is not None)
    table = new_table(*headings)
    names = [name for name in _rows(metrics) if name in evaluation.summary]
    for section, group in itertools.groupby(names, key=lambda name: DEFINITIONS[name].section):
        table.add_section()
        add_row(table, section, style="bold")
        rows = [
            (
                _with_unit(DEFINITIONS[name].short, DEFINITIONS[name].unit),
                _mean_and_std(evaluation, name),
                _interval(evaluation, name),
                "" if baseline is None else _value(baseline, name),
            )
            for name in group
        ]
        if section == "Fingers" and metrics is None:
            rows += [
                (text, _shares(evaluation.mean, of), "", _shares(baseline or {}, of))
                for text, of in _SHARES.items()
            ]
        for text, mean, interval, resting in rows:
            extra = [interval] * intervals + [resting] * (baseline is not None)
            add_row(table, f"  {text}", mean, *extra)
    return table


def _several_runs_table(
    evaluations: Sequence[Evaluation], metrics: Sequence[str], parent: Path
) -> Table:
    """Return named metrics of several evaluations by piece, and 95 % intervals under the means."""
    table = new_table("piece and run", *(label(name).replace(" ", "\n") for name in metrics))
    for column in table.columns[1:]:
        column.no_wrap = True
    by_piece: dict[str, list[Evaluation]] = {}
    for evaluation in evaluations:
        by_piece.setdefault(evaluation.piece, []).append(evaluation)
    for piece, of_piece in by_piece.items():
        table.add_section()
        add_row(table, piece, style="bold")
        for evaluation in of_piece:
            cells = [_mean_and_interval(evaluation, name) for name in metrics]
            add_row(table, _name(evaluation, parent), *cells)
        for heading, cells in _baselines(of_piece, metrics, parent):
            add_row(table, heading, *cells)
            table.rows[-1].style = "italic"
    return table


def _common_parent(evaluations: Iterable[Evaluation]) -> Path:
    """Return the nearest folder that all runs are in; ``.`` if they share none."""
    try:
        return Path(os.path.commonpath([evaluation.run.parent for evaluation in evaluations]))
    except ValueError:  # absolute and relative ones
        return Path()


def _name(evaluation: Evaluation, parent: Path) -> str:
    return str(evaluation.run.relative_to(parent) if parent != Path() else evaluation.run)


def _rows(metrics: Sequence[str] | None) -> list[str]:
    if metrics is not None:
        return [name for name in DEFINITIONS if name in metrics]
    compact = {"noop_f1", *FINGER_SHARES}  # in a column, or five in a row
    return [name for name in DEFINITIONS if name not in compact]


def _shares(metrics: Mapping[str, float], names: Sequence[str]) -> str:
    shares = [metrics[name] for name in names if name in metrics]
    texts = [f"{share:.2f}".removeprefix("0") for share in shares]
    return " ".join(texts) if any(shares) else _NOTHING


def _value(metrics: Mapping[str, float], name: str) -> str:
    """Return a rounded value; a dash where there is none."""
    return rounded(name, metrics[name]) if has_value(name, metrics) else _NOTHING


def _mean_and_std(evaluation: Evaluation, name: str) -> str:
    value = _value(evaluation.mean, name)
    if len(evaluation.episodes) == 1 or value == _NOTHING:
        return value
    return f"{value} ± {rounded(name, evaluation.std[name])}"


def _interval(evaluation: Evaluation, name: str) -> str:
    interval = evaluation.summary[name].interval
    if interval is None or _value(evaluation.mean, name) == _NOTHING:
        return ""
    return "..".join(rounded(name, end) for end in interval)


def _mean_and_interval(evaluation: Evaluation, name: str) -> str:
    if name not in evaluation.summary:
        return _NOTHING
    return f"{_value(evaluation.mean, name)}\n{_interval(evaluation, name)}".rstrip()


def _baselines(
    evaluations: Sequence[Evaluation], metrics: Sequence[str], parent: Path
) -> Iterator[tuple[str, list[str]]]:
    """Yield what playing nothing scores: once if it is the same for all runs on a piece."""
    rows = {
        _name(found, parent): [_value(found.baseline, name) for name in metrics]
        for found in evaluations
        if found.baseline is not None
    }
    same = len({tuple(cells) for cells in rows.values()}) == 1
    for run, cells in rows.items():
        yield "no-op baseline" if same else f"no-op baseline of {run}", cells
        if same:
            return
