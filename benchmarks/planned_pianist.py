"""What plays without training, on built-in pieces: the table of docs/planned_pianist_results.md.

    python benchmarks/planned_pianist.py --out planned.csv
    python benchmarks/planned_pianist.py --pieces debug FurElise --columns planned --out few.csv
    python benchmarks/planned_pianist.py --pieces encore --columns planned refined --losses

Each piece is played once by each column: ``planned`` follows the plan, ``refined`` one that was
refined by two passes before; ``sampling-32`` searches around the plan with 32 samples,
``refined-32`` around the refined one; ``zero`` searches without any plan;
``sight-reader`` is the network that comes with the package; ``planned-tree`` and
``sight-reader-tree`` look ahead with trees of 64 simulations. All joints, half a second before the
first note, the reference physics (of candidates from zero, the fast one). One process for each job,
one thread in each.

A row is appended to the CSV file as soon as it is measured, and what is in the file is not measured
again: stop it and call it again to go on; after a change to the planner begin a new file. Then, and
with ``--pieces none`` at once, it prints the means of groups of pieces in Markdown. Their seconds
are those of planning and playing together, as the processor counts them, so that other work on the
machine does not; the file has those of the clock, too. ``--losses`` prints a row for each piece and
column in place of the means: where frames are lost, and where wrong ones come from.
"""

from __future__ import annotations

import argparse
import csv
import multiprocessing
import os
import time
import warnings
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from sb3_piano.exceptions import PlanWarning
from sb3_piano.metrics.losses import ALL, DUE_KINDS, WRONG_KINDS, Losses
from sb3_piano.music import BUILT_IN
from sb3_piano.players.planned import forget_plans
from sb3_piano.training import OpenPlayer
from sb3_piano.training.playing.player import stage_for
from sb3_piano.training.playing.takes import take_of

COLUMNS: Mapping[str, str] = {
    "planned": "planned",
    "sight-reader": "sight-reader",
    "planned-tree": "tree:64x8:planned",
    "sight-reader-tree": "tree:64x8:sight-reader",
    "refined": "planned:passes=2",
    "sampling-32": "sampling:samples=32,n_threads=1",
    "refined-32": "sampling:samples=32,n_threads=1,passes=2",
    "zero": "sampling:nominal=none,samples=16,horizon=12,physics=fast,n_threads=1",
}
"""Who plays, by name: specs of players."""

UNSEEN = ("repertoire", "encore")
"""Collections whose pieces were not used to find constants, apart from those in ``SEEN``."""

SEEN = ("repertoire-ChopinNocturneOp9No2", "repertoire-MapleLeafRag")
"""Pieces that were looked at when it was decided how much time leaps get and what fingers cost."""

METRICS = ("precision", "recall", "f1", "onset_f1", "noop_f1")
LOSSES = (*DUE_KINDS[1:], *WRONG_KINDS)  # all but those that sound
FIELDS = ("piece", "column", *METRICS, "planning", "playing", "cpu", "music", "problem", *LOSSES)

Row = Mapping[str, str]
Key = tuple[str, str]


def measure(piece: str, column: str) -> dict[str, object]:
    """Return the row of a piece and a column."""
    stage_for(piece).make().close()  # compiles the scene, once in a process
    forget_plans()  # of other columns, which were timed there
    start, clock = time.process_time(), [time.perf_counter()]

    def on_step(done: int, total: int) -> None:
        if done == 1:  # the plan was made before it
            clock.append(time.perf_counter())

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PlanWarning)
        with OpenPlayer.open(COLUMNS[column], score=piece) as player:
            take = take_of(player, on_step)
    clock.append(time.perf_counter())
    told = [str(warning.message) for warning in caught if warning.category is PlanWarning]
    return {
        "piece": piece,
        "column": column,
        **{name: f"{take.metrics[name]:.4f}" for name in METRICS},
        "planning": f"{clock[1] - clock[0]:.2f}",
        "playing": f"{clock[2] - clock[1]:.2f}",
        "cpu": f"{time.process_time() - start:.2f}",
        "music": f"{take.piano.roll.duration:.2f}",
        "problem": " ".join(dict.fromkeys(told)),
        **losses(take.piano.losses()),
    }


def losses(found: Losses) -> dict[str, str]:
    """Return how many frames were lost and wrong, by kind, as shares of those that are due."""
    due = found.due.get(ALL, {})
    counts = {**due, **found.wrong.get(ALL, {})}
    total = max(sum(due.values()), 1)
    return {kind: f"{counts.get(kind, 0) / total:.4f}" for kind in LOSSES}


# The file.


def read_rows(path: Path) -> dict[Key, Row]:
    """Return the rows of a file that was written before, if there is one."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if None not in row.values()]
    return {(row["piece"], row["column"]): row for row in rows}


def append_row(path: Path, row: Mapping[str, object]) -> None:
    """Add a row, the first one below the headings; a file keeps those that it was begun with."""
    is_new = not path.is_file()
    fields: Sequence[str] = FIELDS
    if not is_new:
        with path.open(newline="", encoding="utf-8") as file:
            fields = next(csv.reader(file))
    is_cut_off = not is_new and not path.read_bytes().endswith(b"\n")
    with path.open("a", newline="", encoding="utf-8") as file:
        if is_cut_off:
            file.write("\n")
        writer = csv.DictWriter(file, fields, extrasaction="ignore")
        if is_new:
            writer.writeheader()
        writer.writerow(row)


def complete(path: Path, wanted: Iterable[Key], jobs: int) -> None:
    """Measure what is wanted and not in the file yet."""
    known = read_rows(path)
    missing = [key for key in wanted if key not in known]
    if not missing:
        return
    # numpy reads this when a process starts; one thread each, so that times can be compared.
    os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
    fresh = multiprocessing.get_context("spawn")
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with (
        Progress(*columns, console=Console(stderr=True)) as progress,
        ProcessPoolExecutor(jobs, mp_context=fresh) as pool,
    ):
        task = progress.add_task("Playing", total=len(missing))
        futures = {pool.submit(measure, *key): key for key in missing}
        try:
            for future in as_completed(futures):
                append_row(path, future.result())
                progress.advance(task)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


# Printing.


def is_unseen(piece: str) -> bool:
    """Return whether a piece had no part in finding constants."""
    return BUILT_IN[piece].collection in UNSEEN and piece not in SEEN


def cells(rows: Sequence[Row]) -> str:
    """Return the means of some rows as one cell."""

    def mean(name: str) -> float:
        return sum(float(row[name]) for row in rows) / len(rows)

    if not rows:
        return ""
    return (
        f"{mean('precision'):.3f} / {mean('recall'):.3f} / **{mean('f1'):.3f}** / "
        f"{mean('onset_f1'):.3f} / {mean('cpu'):.1f}"
    )


def groups_of(pieces: Sequence[str]) -> dict[str, list[str]]:
    """Return the pieces of each collection, of all that are unseen, and all of them."""
    groups: dict[str, list[str]] = {}
    for piece in pieces:
        groups.setdefault(f"all of {BUILT_IN[piece].collection}", []).append(piece)
    unseen = [piece for piece in pieces if is_unseen(piece)]
    if unseen:
        groups["all unseen"] = unseen
    groups["all pieces"] = list(pieces)
    return groups


def print_table(rows: Mapping[Key, Row], columns: Sequence[str]) -> None:
    """Print the means of each group: music's length, F1 of playing nothing, and the columns."""
    pieces = [piece for piece in BUILT_IN if any((piece, column) in rows for column in columns)]
    if not pieces:
        print("Nothing is measured yet.")
        return
    print("Precision / recall / **F1** / onset F1 / seconds to plan and play.\n")
    print(f"| group | pieces | music, s | nothing | {' | '.join(columns)} |")
    print(f"| --- | ---: | ---: | ---: |{' --- |' * len(columns)}")
    for name, group in groups_of(pieces).items():
        of = {c: [rows[p, c] for p in group if (p, c) in rows] for c in columns}
        one_each = {row["piece"]: row for found in of.values() for row in found}.values()
        music, nothing = (
            sum(float(row[field]) for row in one_each) / len(one_each)
            for field in ("music", "noop_f1")
        )
        # A mean over fewer pieces than the others' would compare different things.
        shown = [cells(of[c]) if len(of[c]) == len(group) else "-" for c in columns]
        print(f"| {name} | {len(group)} | {music:.1f} | {nothing:.3f} | {' | '.join(shown)} |")


def print_losses(rows: Mapping[Key, Row], columns: Sequence[str]) -> None:
    """Print a row for each piece and column: F1, onset F1, and losses in % of the due frames."""
    heading = [kind.replace("_", " ") for kind in LOSSES]
    print(f"| piece | player | **F1** / onset F1 | {' | '.join(heading)} |")
    print(f"| --- | --- | --- |{' ---: |' * len(heading)}")
    for piece in BUILT_IN:
        for row in (rows[piece, c] for c in columns if LOSSES[0] in rows.get((piece, c), {})):
            shares = [f"{100 * float(row[kind]):.1f}" for kind in LOSSES]
            f1 = f"**{float(row['f1']):.3f}** / {float(row['onset_f1']):.3f}"
            name = piece.removeprefix(f"{BUILT_IN[piece].collection}-")
            print(f"| {name} | {row['column']} | {f1} | {' | '.join(shares)} |")


def chosen(names: Sequence[str]) -> list[str]:
    """Return the pieces that names stand for: of pieces, collections, "all" or "none".

    The encores are not among "all", as the table has none: they are measured by name, to judge.
    """
    found: dict[str, None] = {}
    for name in names:
        matches = [
            full
            for full, piece in BUILT_IN.items()
            if name in (full, piece.collection, full.removeprefix(f"{piece.collection}-"))
            or (name == "all" and piece.collection != "encore")
        ]
        if not matches and name != "none":
            raise SystemExit(f"No built-in piece or collection is called {name!r}.")
        found.update(dict.fromkeys(matches))
    return list(found)


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    add = parser.add_argument
    add("--pieces", nargs="+", default=["all"], metavar="NAME", help="pieces or collections")
    add("--columns", nargs="+", choices=list(COLUMNS), default=list(COLUMNS))
    add("--jobs", type=int, default=2, metavar="N", help="processes; default: 2")
    add("--out", type=Path, default=Path("planned_pianist.csv"), metavar="FILE.csv")
    add("--losses", action="store_true", help="print each piece: where frames are lost, in %%")
    arguments = parser.parse_args()
    # Column by column, so that the cheap ones are whole early.
    wanted = [(piece, column) for column in arguments.columns for piece in chosen(arguments.pieces)]
    complete(arguments.out, wanted, arguments.jobs)
    show = print_losses if arguments.losses else print_table
    show(read_rows(arguments.out), arguments.columns)


if __name__ == "__main__":
    main()
