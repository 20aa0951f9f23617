"""How long planning takes, and how much memory, for pieces of one to ten minutes.

    python benchmarks/planning_time.py
    python benchmarks/planning_time.py --minutes 1 2 4 8 --piece hanon-01

A piece is played end to end again and again, each time in another key, until it is long enough.
Each length is planned in a process of its own with one thread, which starts another one for the
second hand of a long piece. Prints a table in Markdown: notes; seconds of the clock, and those that
the processor counts for the first process, so that other work on the machine does not; the highest
memory of that, all of it and what planning added; and by how much the latter seconds and the added
memory grow when the length doubles, which is 2 where growth is linear.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import resource
import subprocess
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import track

from sb3_piano.exceptions import PlanWarning
from sb3_piano.music import MAX_PITCH, MIN_PITCH, Note, Score, load_score
from sb3_piano.planning import plan
from sb3_piano.simulation import compile_scene

MINUTES = (1.0, 2.5, 5.0, 10.0)
REST = 0.5
"""Time between two rounds, s."""
WARM_UP = 5.0
"""Length of what is planned first, so that imports and caches are not counted, s."""


def long_score(name: str, seconds: float) -> Score:
    """Return a piece end to end, in other keys each time round, cut at a length."""
    score = load_score(name)
    low, high = score.pitch_range
    notes: list[Note] = []
    start = 0.0
    for number in itertools.count():
        # Up by fourths, within five semitones of the piece's own key.
        shift = min(max((5 * number + 5) % 12 - 5, MIN_PITCH - low), MAX_PITCH - high)
        for note in score.transpose(shift).notes:
            moved = replace(note, onset=note.onset + start, offset=note.offset + start)
            if moved.offset <= seconds:
                notes.append(moved)
        start += score.duration + REST
        if start > seconds:
            return Score(notes=notes, title=f"{name}, {seconds:.0f} s")
    raise AssertionError("itertools.count does not end")


def memory() -> float:
    """Return the highest memory of this process so far, MB."""
    kilobytes = 1 / 1024 if sys.platform == "darwin" else 1
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * kilobytes / 1024


def measure(name: str, seconds: float) -> dict[str, float]:
    """Return what planning costs in this process."""
    scene = compile_scene()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PlanWarning)
        plan(long_score(name, WARM_UP), scene)
        score, before = long_score(name, seconds), memory()
        clock, start = time.perf_counter(), time.process_time()
        made = plan(score, scene)
        clock, took = time.perf_counter() - clock, time.process_time() - start
    return {
        "minutes": seconds / 60,
        "notes": len(score.notes),
        "problems": len(made.problems),
        "clock": clock,
        "seconds": took,
        "memory": memory(),
        "added": memory() - before,
    }


def measured_apart(name: str, minutes: float) -> dict[str, float]:
    """Return the same of a process of its own."""
    here = Path(__file__)
    # As a module: from a script no processes are started.
    command = [sys.executable, "-m", here.stem, "--piece", name]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    done = subprocess.run(
        [*command, "--here", str(60 * minutes)],
        cwd=here.resolve().parent,
        env={**os.environ, **threads},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return dict(json.loads(done.stdout))


def per_doubling(shorter: dict[str, float], longer: dict[str, float], what: str) -> str:
    """Return by how much something grows from one length to the next, for each doubling."""
    if min(shorter[what], longer[what]) <= 0:
        return "-"
    doublings = math.log2(longer["minutes"] / shorter["minutes"])
    return f"{(longer[what] / shorter[what]) ** (1 / doublings):.2f}"


def print_table(rows: Sequence[dict[str, float]]) -> None:
    """Print the rows, each with its growth from the one before."""
    print("| minutes | notes | not playable | clock, s | s | per doubling | MB | added | growth |")
    print(f"|{' ---: |' * 9}")
    for before, row in zip([None, *rows], rows, strict=False):
        growth = [
            "" if before is None else per_doubling(before, row, what)
            for what in ("seconds", "added")
        ]
        print(
            f"| {row['minutes']:g} | {row['notes']} | {row['problems']} | {row['clock']:.1f} | "
            f"{row['seconds']:.1f} | "
            f"{growth[0]} | {row['memory']:.0f} | {row['added']:.0f} | {growth[1]} |"
        )


def main() -> None:
    """Read the command line, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    add = parser.add_argument
    add("--piece", default="FurElise", metavar="NAME", help="default: FurElise")
    add("--minutes", type=float, nargs="+", default=list(MINUTES), metavar="N")
    add("--here", type=float, metavar="SECONDS", help="measure one length in this process")
    arguments = parser.parse_args()
    if arguments.here is not None:
        print(json.dumps(measure(arguments.piece, arguments.here)))
        return
    console = Console(stderr=True)
    rows = [
        measured_apart(arguments.piece, minutes)
        for minutes in track(sorted(arguments.minutes), "Planning", console=console)
    ]
    print_table(rows)


if __name__ == "__main__":
    main()
