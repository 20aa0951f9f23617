"""Play pieces, and write how well into results.json.

    python docs/results/measure.py
    python docs/results/measure.py --pieces repertoire hanon-01 --players sight-reader --seeds 0 1

By default the twelve pieces of the repertoire by the sight-reader and the planned pianist, on the
reference physics, one seed: whoever plays without sampling plays the same with every seed. Each
result is written as soon as it is measured, in place of the one that was there.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import platform
import time
import typing
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

from records import FILE, Physics, Result, Results

import sb3_piano
from sb3_piano.exceptions import PlanWarning
from sb3_piano.files import write_text
from sb3_piano.music import Score, load_score, select_pieces
from sb3_piano.planning import forget_plans
from sb3_piano.players import TreeSettings
from sb3_piano.training.playing.player import env_to_record
from sb3_piano.training.playing.takes import planner_config, take_of_planner

TREE = TreeSettings(simulations=64, depth=8)

PLAYERS: Mapping[str, tuple[str, TreeSettings | None]] = {
    "sight-reader": ("sight-reader", None),
    "planned": ("planned", None),
    "sight-reader-tree": ("sight-reader", TREE),
}
"""Algorithm of each player, and the tree by which it looks ahead, if it does."""


def digest(score: Score) -> str:
    """Return the SHA-256 of what is to be played: notes and pedals, times to a microsecond.

    Title and bar lines do not count. The text that is digested is JSON without spaces: a list of
    [onset, offset, pitch, velocity, finger] for each note and one of [onset, offset] for each
    pedal, times in whole microseconds.
    """
    notes = [
        [_microseconds(n.onset), _microseconds(n.offset), n.pitch, n.velocity, n.finger]
        for n in score.notes
    ]
    pedals = [[_microseconds(p.onset), _microseconds(p.offset)] for p in score.pedals]
    return hashlib.sha256(json.dumps([notes, pedals], separators=(",", ":")).encode()).hexdigest()


def _microseconds(seconds: float) -> int:
    return round(seconds * 1e6)


def measure(
    piece: str, player: str, seeds: Sequence[int], physics: Physics = "reference"
) -> Result:
    """Return how well a player plays a piece, one episode for each seed."""
    algo, tree = PLAYERS[player]
    played, cpu = [], 0.0
    for seed in seeds:
        config = planner_config(piece, algo, seed=seed, env_kwargs={"physics": physics})
        env_to_record(config).close()  # compiles the scene, once in a process
        forget_plans()
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PlanWarning)  # notes that cannot be played as written
            played.append(take_of_planner(config, tree=tree).metrics)
        cpu += time.process_time() - start
    return Result(
        piece=piece,
        score_sha256=digest(load_score(piece)),
        player=player,
        physics=physics,
        seeds=tuple(seeds),
        f1=tuple(round(metrics["f1"], 4) for metrics in played),
        onset_f1=tuple(round(metrics["onset_f1"], 4) for metrics in played),
        noop_f1=round(played[0]["noop_f1"], 4),
        cpu_seconds=round(cpu / len(seeds), 1),
        package_version=sb3_piano.__version__,
        hardware=hardware(),
        command=command(piece, player, seeds, physics),
        date=datetime.datetime.now(datetime.UTC).date(),
    )


def command(piece: str, player: str, seeds: Sequence[int], physics: str) -> str:
    """Return the command that measures one result again."""
    text = f"python docs/results/measure.py --pieces {piece} --players {player}"
    text += f" --seeds {' '.join(map(str, seeds))}"
    return text if physics == "reference" else f"{text} --physics {physics}"


def hardware() -> str:
    """Return the processor in words."""
    names = [
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        if line.startswith("model name")
    ]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def write(results: Results, file: Path) -> None:
    """Write a file that :meth:`Results.read` reads, a result in each line."""
    head = f'{{"schema_version": {results.schema_version}, '
    head += f'"metrics_version": {results.metrics_version}, "results": [\n'
    rows = (json.dumps(r.model_dump(mode="json"), ensure_ascii=False) for r in results.results)
    write_text(file, head + ",\n".join(rows) + "\n]}\n")


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, measure, write and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    add = parser.add_argument
    add("--pieces", nargs="+", default=["repertoire"], metavar="NAME", help="or a collection")
    add("--players", nargs="+", choices=list(PLAYERS), default=["sight-reader", "planned"])
    add("--seeds", nargs="+", type=int, default=[0], metavar="N")
    add("--physics", choices=typing.get_args(Physics), default="reference")
    add("--out", type=Path, default=FILE, metavar="FILE.json")
    given = parser.parse_args(arguments)
    results = Results.read(given.out) if given.out.is_file() else Results()
    for player in given.players:
        for piece in select_pieces(given.pieces):
            result = measure(str(piece), player, given.seeds, given.physics)
            results = results.merged([result])
            write(results, given.out)
            print(f"{piece} by {player}: F1 {result.f1}, onset F1 {result.onset_f1}", flush=True)


if __name__ == "__main__":
    main()
