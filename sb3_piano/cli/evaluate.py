"""``sb3-piano evaluate``: scores of trained models and other players, alone or compared."""

from __future__ import annotations

import argparse
import itertools
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    TRUST,
    add_row,
    adder,
    command,
    new_table,
    print_errors,
    print_interrupted,
    print_narrowness,
    print_table,
    progress_bar,
    whole_number,
)
from sb3_piano.cli.losses import HELP, print_losses
from sb3_piano.exceptions import SB3PianoError
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.metrics.episode import FINGER_SHARES, definition_of, has_value, in_order
from sb3_piano.metrics.musicianship import MUSICIANSHIP

if TYPE_CHECKING:
    from rich.table import Table

    from sb3_piano.training.evaluation.evaluations import Evaluation, Evaluations

_MOST_FILES_LISTED = 5
_REPETITION = (
    "all episodes are the same: nothing is random, so one would do, and there is no interval."
)
_NOTHING = "-"
_SHARES = {
    "shares, right thumb to little": FINGER_SHARES[:5],
    "shares, left thumb to little": FINGER_SHARES[5:],
}
_EQUAL_F1 = 0.0005
"""Difference of F1 that a table rounds to 0."""
_METRICS_IN_TABLE = 5
"""Columns of metrics that fit on most terminals."""

_SCORE_HELP = (
    "piece to play instead of each run's own: its name, or a file such as MIDI; repeatable"
)
_MUSICAL_HELP = "also judge endings, loudness, chords, timing by hand, legato and pedal"
_MOTION_HELP = "also write all motion to performance_<i>.npz beside each MIDI file"


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _evaluate, epilog=TRUST)
    either = adder(parser.add_mutually_exclusive_group())
    who = "a run's folder, or another player (needs --score); several are compared"
    add("runs", "RUN|PLAYER", who, nargs="+")
    add("--episodes", "N", "episodes per seed", whole_number, 1)
    either("--seed", "N", "random seed", int, 0)
    either("--seeds", "N", "several random seeds", int, nargs="+")
    add("--score", "PIECE", _SCORE_HELP, action="append")
    add("--physics")
    add("--best")
    add("--tree")
    add("--motion", text=_MOTION_HELP)
    add("--metrics", "NAME", "metrics to show, such as f1 onset_f1 return", nargs="+")
    add("--musical", text=_MUSICAL_HELP)
    add("--losses", text=HELP)
    add("--csv", text="write one row per episode to a CSV file")
    add("--json")
    add("--no-progress")


def evaluate_run(run: str) -> None:
    """Evaluate a run and print the results."""
    from sb3_piano.training import evaluate

    _show_one(evaluate(run))


def label(name: str) -> str:
    """Return the full label of a metric; the name of an unknown one."""
    known = definition_of(name)
    return _with_unit(known.label, known.unit)


def rounded(name: str, *values: float) -> str:
    """Format a value of a metric, or both ends of an interval, with the metric's decimals."""
    return "..".join(map(definition_of(name).rounded, values))


def _with_unit(text: str, unit: str) -> str:
    return f"{text}{'' if unit.startswith('/') or not unit else ', '}{unit}"


def _evaluate(arguments: argparse.Namespace) -> int:
    from sb3_piano.players import TreeSettings
    from sb3_piano.settings import refuse_unknown
    from sb3_piano.training.evaluation.evaluate import evaluate_runs

    players = arguments.runs
    if arguments.tree is not None:
        players = [f"tree:{TreeSettings.parse(arguments.tree)}:{run}" for run in players]
    named = (n for n in arguments.metrics or [] if definition_of(n).section != "Return")
    refuse_unknown(named, DEFINITIONS, "metric")  # reward terms may be of one's own
    asked = not set(MUSICIANSHIP).isdisjoint(arguments.metrics or ())
    seeds, scores = arguments.seeds or [arguments.seed], arguments.score or []
    count = sum(len(scores) or _n_pieces(run) for run in arguments.runs)
    arguments.no_progress |= count == 1
    with progress_bar(arguments, "episodes") as tell:
        tell(total=count * arguments.episodes * len(seeds))
        found = evaluate_runs(
            players,
            arguments.episodes,
            seeds,
            physics=arguments.physics,
            scores=scores,
            best=arguments.best,
            motion=arguments.motion,
            musical=arguments.musical or asked,
            on_episode=lambda: tell(advance=1),
        )
    if found.evaluations:
        _show(found, arguments.metrics)
        if arguments.losses:
            _show_losses(found.evaluations)
        if arguments.csv is not None:
            found.write_csv(arguments.csv)
            print(f"Episodes:    {arguments.csv}")
        if arguments.json is not None:
            found.write_json(arguments.json)
            print(f"Everything:  {arguments.json}")
    return print_interrupted(found.interrupted, print_errors(*found.failures))


def _n_pieces(run: str) -> int:
    from sb3_piano.training import RunFolder
    from sb3_piano.training.evaluation.evaluate import pieces_of

    try:
        return len(pieces_of(RunFolder.open(run)))
    except SB3PianoError:  # reported by its evaluation
        return 1


def _show(found: Evaluations, metrics: list[str] | None) -> None:
    first, *others = found.evaluations
    if not others and not found.failures:
        _show_one(first, metrics)
        return
    from sb3_piano.training.evaluation.comparison import MAIN_METRICS

    parent = _common_parent(found.evaluations)
    if str(parent) != ".":
        print(f"Runs in {parent}")
    known = [n for n in MAIN_METRICS if any(n in e.summary for e in found.evaluations)]
    names = metrics or known
    for start in range(0, len(names), _METRICS_IN_TABLE):
        shown = names[start : start + _METRICS_IN_TABLE]
        print_table(_several_runs_table(found.evaluations, shown, parent))
    varying = [len(found.episodes) for found in found.evaluations if found.has_interval]
    per_run = Counter(evaluation.run for evaluation in found.evaluations)
    over_pieces = [count for count in per_run.values() if count > 1]
    if varying or over_pieces:
        print("Means over all episodes of all seeds; below, where they vary, 95 % intervals.")
        print_narrowness(min(varying + over_pieces))
    n_repeated = sum(evaluation.is_repetition for evaluation in found.evaluations)
    if n_repeated:
        print(f"In {n_repeated} of {len(found.evaluations)} rows {_REPETITION}")
    if len({evaluation.run for evaluation in found.evaluations}) == 1:
        _list_files(found.evaluations)


def _show_one(evaluation: Evaluation, metrics: list[str] | None = None) -> None:
    n_episodes = len(evaluation.episodes)
    plural = "episode" if n_episodes == 1 else "episodes"
    print(
        f"{evaluation.piece}: {n_episodes} {plural}, model after {evaluation.num_timesteps} steps "
        "of training"
    )
    print_table(_one_run_table(evaluation, metrics))
    if evaluation.has_interval:
        print_narrowness(n_episodes)
    if evaluation.is_repetition:
        print(f"Here {_REPETITION}")
    if evaluation.tree is not None:
        print(
            f"Trees:       {evaluation.tree.children:.1f} actions at the root, "
            f"{evaluation.tree.deepest:.1f} control steps deep; "
            f"{evaluation.tree.visit_share:.0%} of the simulations went to the best action"
        )
    _list_files([evaluation])


def _show_losses(evaluations: Sequence[Evaluation]) -> None:
    """Print the losses of each run, summed over its pieces."""
    from sb3_piano.metrics import Losses

    for run, group in itertools.groupby(evaluations, key=lambda found: found.run):
        losses = [found.losses for found in group if found.losses is not None]
        print(f"Losses of {run}:")
        if losses:
            print_losses(Losses.sum_of(losses))
        else:
            print("none, as its environment is no piano")


def _list_files(evaluations: Sequence[Evaluation]) -> None:
    """Print the files of a run, over all its pieces."""
    metrics_file = evaluations[0].metrics_file
    if metrics_file is None:
        return
    played = [path for e in evaluations if e.baseline is not None for path in e.performances]
    written = [path for path in played if path is not None]
    for path in written[:_MOST_FILES_LISTED]:
        print(f"Performance: {path}")
    if len(written) > _MOST_FILES_LISTED:
        print(f"             and {len(written) - _MOST_FILES_LISTED} more")
    n_silent = len(played) - len(written)
    if n_silent > 0:
        print(
            f"Performance: no key was pressed in {n_silent} of {len(played)} episodes, so there is "
            "no MIDI file"
        )
    motions = [path for evaluation in evaluations for path in evaluation.motions]
    if motions:
        more = f" and {len(motions) - 1} more" if len(motions) > 1 else ""
        print(f"Motion:      {motions[0]}{more}")
    print(f"Metrics:     {metrics_file}")


def _one_run_table(evaluation: Evaluation, metrics: Sequence[str] | None) -> Table:
    """Return a table of all metrics of an evaluation, or of the named ones, by section."""
    mean, baseline = evaluation.mean, evaluation.baseline
    has_interval, has_baseline = evaluation.has_interval, baseline is not None
    headings = ["metric", "policy (mean ± std)" if len(evaluation.episodes) > 1 else "policy"]
    headings += ["95 % interval"] * has_interval + ["no-op baseline"] * has_baseline
    table = new_table(*headings)

    def add(text: str, policy: str, interval: str, resting: str) -> None:
        extra = [interval] * has_interval + [resting] * has_baseline
        add_row(table, f"  {text}", policy, *extra)

    compact = {"noop_f1", *FINGER_SHARES}  # in a column, or five in a row
    names = [n for n in in_order(mean) if (n not in compact if metrics is None else n in metrics)]
    for section, group in itertools.groupby(names, key=lambda name: definition_of(name).section):
        table.add_section()
        add_row(table, section, style="bold")
        for name in group:
            value = _value(mean, name)
            if len(evaluation.episodes) > 1 and value != _NOTHING:
                value += f" ± {rounded(name, evaluation.std[name])}"
            text = _with_unit(definition_of(name).short, definition_of(name).unit)
            add(text, value, _interval(evaluation, name), _value(baseline or {}, name))
        if section == "Fingers" and metrics is None:
            for text, of in _SHARES.items():
                add(text, _shares(mean, of), "", _shares(baseline or {}, of))
    return table


def _several_runs_table(
    evaluations: Sequence[Evaluation], metrics: Sequence[str], parent: Path
) -> Table:
    """Return a table of several evaluations by piece: means over their 95 % intervals."""
    table = new_table("piece and run", *(label(name).replace(" ", "\n") for name in metrics))
    for column in table.columns[1:]:
        column.no_wrap = True
    by_piece: dict[str, list[Evaluation]] = defaultdict(list)
    for evaluation in evaluations:
        by_piece[evaluation.piece].append(evaluation)
    for piece, of_piece in by_piece.items():
        table.add_section()
        add_row(table, piece, style="bold")
        resting: dict[str, tuple[str, ...]] = {}
        for found in of_piece:
            run = str(found.run.relative_to(parent) if parent != Path() else found.run)
            values = ((_value(found.mean, name), _interval(found, name)) for name in metrics)
            add_row(table, run, *("\n".join(value).rstrip() for value in values))
            if found.baseline is not None:
                resting[run] = tuple(_value(found.baseline, name) for name in metrics)
        same = len(set(resting.values())) == 1
        for run, cells in itertools.islice(resting.items(), 1 if same else None):
            add_row(table, "no-op baseline" if same else f"no-op baseline of {run}", *cells)
            table.rows[-1].style = "italic"
    _add_means(table, evaluations, metrics, parent)
    return table


def _add_means(
    table: Table, evaluations: Sequence[Evaluation], metrics: Sequence[str], parent: Path
) -> None:
    """Add each run's means over all pieces, and over those where its F1 differs from rest."""
    by_run: dict[Path, list[Evaluation]] = defaultdict(list)
    for evaluation in evaluations:
        by_run[evaluation.run].append(evaluation)
    several = {run: of_run for run, of_run in by_run.items() if len(of_run) > 1}
    if several:
        table.add_section()
        add_row(table, "mean over pieces", style="bold")
    for run, of_run in several.items():
        name = str(run.relative_to(parent) if parent != Path() else run)
        played = [found for found in of_run if not _as_if_resting(found)]
        groups = {f"{name}, all {len(of_run)}": of_run}
        if 0 < len(played) < len(of_run):
            groups[f"{name}, {len(played)} without those as of resting hands"] = played
        for text, group in groups.items():
            cells = (_mean(group, metric) for metric in metrics)
            add_row(table, text, *cells)


def _mean(evaluations: Sequence[Evaluation], name: str) -> str:
    """Format the mean of a metric over pieces, with its 95 % interval below."""
    from sb3_piano.training.evaluation.statistics import summarize

    means = [found.mean[name] for found in evaluations if has_value(name, found.mean)]
    if not means:
        return _NOTHING
    summary = summarize(means)
    mean = rounded(name, summary.mean)
    return mean if summary.interval is None else f"{mean}\n{rounded(name, *summary.interval)}"


def _as_if_resting(evaluation: Evaluation) -> bool:
    """Return whether the F1 equals that of resting hands."""
    if evaluation.baseline is None or not has_value("f1", evaluation.mean):
        return False
    return abs(evaluation.mean["f1"] - evaluation.baseline["f1"]) < _EQUAL_F1


def _common_parent(evaluations: Iterable[Evaluation]) -> Path:
    """Return the nearest common folder of all runs; ``.`` if they share none."""
    try:
        return Path(os.path.commonpath([evaluation.run.parent for evaluation in evaluations]))
    except ValueError:  # absolute and relative ones
        return Path()


def _shares(metrics: Mapping[str, float], names: Sequence[str]) -> str:
    shares = [metrics[name] for name in names if name in metrics]
    texts = [f"{share:.2f}".removeprefix("0") for share in shares]
    return " ".join(texts) if any(shares) else _NOTHING


def _value(metrics: Mapping[str, float], name: str) -> str:
    """Format a value; a dash if it is missing."""
    return rounded(name, metrics[name]) if has_value(name, metrics) else _NOTHING


def _interval(evaluation: Evaluation, name: str) -> str:
    """Format the 95 % interval of a mean; empty if it is missing."""
    interval = evaluation.summary[name].interval if has_value(name, evaluation.mean) else None
    return "" if interval is None else rounded(name, *interval)
