"""``sb3-piano evaluate`` and ``compare``: what trained models reach, alone and beside others."""

from __future__ import annotations

import argparse
import itertools
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    add_command,
    add_row,
    adder,
    new_table,
    print_narrowness,
    print_table,
    progress_bar,
    tell_errors,
    tell_interrupted,
    whole_number,
)
from sb3_piano.metrics import DEFINITIONS, FINGER_SHARES, Definition, has_value

if TYPE_CHECKING:
    from rich.table import Table

    from sb3_piano.training import Comparison, Evaluation, Evaluations
    from sb3_piano.training.evaluation.comparison import MetricComparison

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

_SCORE_HELP = (
    "a file, such as MIDI, or a piece's name, to be played in place of each run's own piece; may "
    "be given several times"
)
_MOTION_HELP = "also write how everything moved, as performance_<i>.npz beside each MIDI file"


_BY_HELP = (
    "pair the means of each piece (default), or those of each seed of a piece: of the evaluation, "
    "or of the training"
)


def add_parser(commands: Any) -> None:
    """Add both commands and their arguments."""
    parser = commands.add_parser("evaluate", help="let trained models play", epilog=TRUST)
    parser.set_defaults(command=_evaluate)
    add, either = adder(parser), adder(parser.add_mutually_exclusive_group())
    add("runs", "RUN", "a folder that train made; several are compared", nargs="+")
    add("--episodes", "N", "of each seed", whole_number, 1)
    either("--seed", "N", "", int, 0)
    either("--seeds", "N", "several, in its place", int, nargs="+")
    add("--score", "PIECE", _SCORE_HELP, action="append")
    add("--physics")
    add("--best")
    add("--motion", text=_MOTION_HELP)
    add("--metrics", "NAME", "show these, such as f1 onset_f1 return", nargs="+")
    add("--csv", text="write a row for each episode")
    add("--json")
    add("--no-progress")
    add = add_command(commands, "compare", _compare, "compare two evaluations piece by piece")
    add("a", "A", "a JSON file of evaluate, an evaluated run, or a folder of evaluated runs")
    add("b", "B", "likewise; differences are B - A")
    add("--metric", "NAME", "such as f1; may be given several times", action="append")
    by = ("piece", "seed", "training-seed")
    add("--by", text=_BY_HELP, default="piece", choices=by)
    add("--csv", text="write a row for each metric and pair")
    add("--json")


def evaluate_run(run: str) -> None:
    """Evaluate a run and print what was found."""
    from sb3_piano.training import evaluate

    _show_one(evaluate(run))


def label(name: str) -> str:
    """Return what a metric is called where it stands alone; one from elsewhere by its name."""
    known = _definition(name)
    return _with_unit(known.label, known.unit)


def rounded(name: str, *values: float) -> str:
    """Return the value of a metric, or both ends of an interval, with its number of decimals."""
    return "..".join(map(_definition(name).rounded, values))


def _definition(name: str) -> Definition:
    return DEFINITIONS.get(name, Definition(name, "", name, "", name))


def _with_unit(text: str, unit: str) -> str:
    return f"{text}{'' if unit.startswith('/') or not unit else ', '}{unit}"


def _evaluate(arguments: argparse.Namespace) -> int:
    from sb3_piano.settings import refuse_unknown
    from sb3_piano.training import evaluate_runs

    refuse_unknown(arguments.metrics or [], DEFINITIONS, "metric")
    seeds, scores = arguments.seeds or [arguments.seed], arguments.score or []
    count = len(arguments.runs) * max(len(scores), 1)
    arguments.no_progress |= count == 1
    with progress_bar(arguments, "episodes") as tell:
        tell(total=count * arguments.episodes * len(seeds))
        found = evaluate_runs(
            arguments.runs,
            arguments.episodes,
            seeds,
            physics=arguments.physics,
            scores=scores,
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
    return tell_interrupted(found.interrupted, tell_errors(*found.failures))


def _show(found: Evaluations, metrics: list[str] | None) -> None:
    first, *others = found.evaluations
    if not others and not found.failures:
        _show_one(first, metrics)
        return
    from sb3_piano.training import MAIN_METRICS

    parent = _common_parent(found.evaluations)
    if str(parent) != ".":
        print(f"Runs in {parent}")
    known = [n for n in MAIN_METRICS if any(n in e.summary for e in found.evaluations)]
    names = metrics or known
    for start in range(0, len(names), _METRICS_IN_TABLE):
        shown = names[start : start + _METRICS_IN_TABLE]
        print_table(_several_runs_table(found.evaluations, shown, parent))
    varying = [len(found.episodes) for found in found.evaluations if found.has_interval]
    if varying:
        print("Means over all episodes of all seeds; below, where they vary, 95 % intervals.")
        print_narrowness(min(varying))
    n_repeated = sum(evaluation.is_repetition for evaluation in found.evaluations)
    if n_repeated:
        print(f"In {n_repeated} of {len(found.evaluations)} rows {_REPETITION}")


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
    mean, baseline = evaluation.mean, evaluation.baseline
    has_interval, has_baseline = evaluation.has_interval, baseline is not None
    headings = ["metric", "policy (mean ± std)" if len(evaluation.episodes) > 1 else "policy"]
    headings += ["95 % interval"] * has_interval + ["no-op baseline"] * has_baseline
    table = new_table(*headings)

    def add(text: str, policy: str, interval: str, resting: str) -> None:
        extra = [interval] * has_interval + [resting] * has_baseline
        add_row(table, f"  {text}", policy, *extra)

    compact = {"noop_f1", *FINGER_SHARES}  # in a column, or five in a row
    wanted = DEFINITIONS.keys() - compact if metrics is None else metrics
    names = [name for name in DEFINITIONS if name in mean and name in wanted]
    for section, group in itertools.groupby(names, key=lambda name: DEFINITIONS[name].section):
        table.add_section()
        add_row(table, section, style="bold")
        for name in group:
            value = _value(mean, name)
            if len(evaluation.episodes) > 1 and value != _NOTHING:
                value += f" ± {rounded(name, evaluation.std[name])}"
            text = _with_unit(DEFINITIONS[name].short, DEFINITIONS[name].unit)
            add(text, value, _interval(evaluation, name), _value(baseline or {}, name))
        if section == "Fingers" and metrics is None:
            for text, of in _SHARES.items():
                add(text, _shares(mean, of), "", _shares(baseline or {}, of))
    return table


def _several_runs_table(
    evaluations: Sequence[Evaluation], metrics: Sequence[str], parent: Path
) -> Table:
    """Return named metrics of several evaluations by piece, and 95 % intervals under the means."""
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
    return table


def _common_parent(evaluations: Iterable[Evaluation]) -> Path:
    """Return the nearest folder that all runs are in; ``.`` if they share none."""
    try:
        return Path(os.path.commonpath([evaluation.run.parent for evaluation in evaluations]))
    except ValueError:  # absolute and relative ones
        return Path()


def _shares(metrics: Mapping[str, float], names: Sequence[str]) -> str:
    shares = [metrics[name] for name in names if name in metrics]
    texts = [f"{share:.2f}".removeprefix("0") for share in shares]
    return " ".join(texts) if any(shares) else _NOTHING


def _value(metrics: Mapping[str, float], name: str) -> str:
    """Return a rounded value; a dash where there is none."""
    return rounded(name, metrics[name]) if has_value(name, metrics) else _NOTHING


def _interval(evaluation: Evaluation, name: str) -> str:
    """Return the 95 % interval of a mean; nothing where there is none."""
    interval = evaluation.summary[name].interval if has_value(name, evaluation.mean) else None
    return "" if interval is None else rounded(name, *interval)


def _compare(arguments: argparse.Namespace) -> int:
    from sb3_piano.files import write_json
    from sb3_piano.training import compare

    comparison = compare(arguments.a, arguments.b, arguments.metric, by=arguments.by)
    _show_comparison(comparison)
    if arguments.csv is not None:
        comparison.write_csv(arguments.csv)
        print(f"Pairs:      {arguments.csv}")
    if arguments.json is not None:
        write_json(arguments.json, comparison.to_json())
        print(f"Everything: {arguments.json}")
    return EXIT_OK


def _show_comparison(comparison: Comparison) -> None:
    print(f"A: {comparison.a}\nB: {comparison.b}")
    print_table(_pairs_table(comparison))
    print_table(_summary_table(comparison))
    for note in _notes(comparison):
        print(note)
    if any(found.difference.interval is not None for found in comparison.metrics):
        print_narrowness(len(comparison.metrics[0].pairs))


def _pairs_table(comparison: Comparison) -> Table:
    """Return each pair of each metric."""
    table = new_table("pair", "A", "B", "B - A")
    for found in comparison.metrics:
        table.add_section()
        add_row(table, label(found.metric), style="bold")
        for pair in found.pairs:
            name = pair.piece if pair.seed is None else f"{pair.piece}, seed {pair.seed}"
            values = (rounded(found.metric, pair.a), rounded(found.metric, pair.b))
            add_row(table, name, *values, _signed(found.metric, pair.difference))
    return table


def _summary_table(comparison: Comparison) -> Table:
    """Return the statistics of each metric."""
    headings = ("mean A", "mean B", "B - A", "95 % interval", "A < B", "Wilcoxon p")
    table = new_table("metric", *headings)
    for found in comparison.metrics:
        metric, interval, p = found.metric, found.difference.interval, found.test.p
        add_row(
            table,
            label(metric),
            rounded(metric, found.mean_a),
            rounded(metric, found.mean_b),
            _signed(metric, found.difference.mean),
            "-" if interval is None else "..".join(_signed(metric, end) for end in interval),
            f"{found.n_a_below_b} of {len(found.pairs)}",
            "-" if p is None else "< 0.0001" if p < 0.0001 else f"{p:.3g}",
        )
    return table


def _signed(metric: str, value: float) -> str:
    text = rounded(metric, value)
    return f"+{text}" if float(text) > 0 else text


def _notes(comparison: Comparison) -> Iterator[str]:
    """Yield in words what the tables do not tell."""
    if comparison.physics_a != comparison.physics_b or len(comparison.physics_a) > 1:
        yield (
            f"Not played on the same physics: A on {' and '.join(comparison.physics_a)}, B on "
            f"{' and '.join(comparison.physics_b)}. To play both on one: sb3-piano evaluate "
            "--physics."
        )
    for side, missing in (("A", comparison.only_in_a), ("B", comparison.only_in_b)):
        if missing:
            yield f"Left out, as only {side} has them: {'; '.join(missing)}."
    remarks: dict[str, list[str]] = {}
    for found in comparison.metrics:
        for remark in _remarks(found):
            remarks.setdefault(remark, []).append(label(found.metric))
    for remark, names in remarks.items():
        of_all = len(names) == len(comparison.metrics)
        yield f"{remark}." if of_all else f"{remark} ({', '.join(names)})."


def _remarks(found: MetricComparison) -> Iterator[str]:
    test = found.test
    if found.difference.no_interval is not None:
        yield f"No interval: {found.difference.no_interval}"
    if test.no_test is not None:
        yield f"No test: {test.no_test}"
        return
    n_equal = len(found.pairs) - test.n
    if n_equal > 0:
        yield f"{n_equal} equal {_pairs(n_equal)} left out of the test"
    if test.least_p is not None and test.least_p > 0.05:
        yield f"With {test.n} {_pairs(test.n)} p cannot be below {test.least_p:g}"


def _pairs(count: int) -> str:
    return "pair" if count == 1 else "pairs"
