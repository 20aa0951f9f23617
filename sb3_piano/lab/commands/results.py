"""``sb3-piano results``: measure, check and show files of results."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    add_command,
    check_output_file,
    progress_bar,
    whole_number,
)
from sb3_piano.exceptions import ConfigError

_EXIT_DIFFERENT = 1
_SAMPLE = 3

_Job = TypeVar("_Job")
_Found = TypeVar("_Found")


def add_arguments(parser: Any) -> None:
    """Add the subcommands."""
    parts = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    add = add_command(parts, "measure", _measure, "evaluate players and write a file", epilog=TRUST)
    add("--pieces", "PIECE", "pieces: names, files or collections; default: repertoire", nargs="+")
    add("--held-out", text="use the pieces and seeds of the held-out list")
    players = ["sight-reader", "planned"]
    add("--player", "PLAYER", _PLAYERS_HELP, nargs="+", default=players, dest="players")
    add("--seeds", "N", "random seeds, one episode each; default: 0 to 4", int, nargs="+")
    add("--noise", "RAD", "standard deviation of action noise; default: 0.0001", float)
    add("--physics", "NAME", "physics profile", default="reference")
    add("--out", "FILE.json", "output file; keeps its other results", Path)
    _add_workers(add)
    add = add_command(
        parts,
        "check",
        _check,
        "replay results of a file; exit status 1 if they differ",
        epilog=TRUST,
    )
    add("file", "FILE", "file of results", Path)
    add("--sample", "N", f"number of results to replay; default: {_SAMPLE}", whole_number)
    add("--all", text="replay all results")
    add("--seed", "N", "random seed of the sample", int, 0)
    add(
        "--tolerance",
        "X",
        "allowed difference of means, added to 3 standard errors of the difference",
        float,
        0.01,
    )
    _add_workers(add)
    add = add_command(parts, "table", _table, "show the results of a file, as Markdown")
    add("file", "FILE", "file of results", Path)
    add("--physics", "NAME", "physics profile", default="reference")
    add("--origin", text="also show the origin of each result")
    about = "judge people, and players of the same pieces, by recordings with beats, as of (n)ASAP"
    add = add_command(parts, "human", _human, about, epilog=TRUST)
    add("folder", "FOLDER", "folder with a folder for each piece", Path)
    refined = f"{_PLAYERS_HELP}; refined-N after N passes"
    add("--player", "PLAYER", refined, nargs="+", default=[], dest="players")
    add("--performed", text="players copy the recording; default: they play the score in its tempo")
    add("--seconds", "S", "length of the beginning that counts; default: 60", float, 60.0)
    add("--out", "FILE.json", "output file; what it has is not played again", Path)
    add("--no-progress")


_PLAYERS_HELP = "planned, sampling-32, sight-reader, sight-reader-tree, or a run's folder"


def _add_workers(add: Callable[..., None]) -> None:
    add("--workers", "N", "playing processes; default: one per core", whole_number)
    add("--no-progress")


def _measure(arguments: argparse.Namespace) -> int:
    from sb3_piano.lab.results import Measurement, Results, held_out, measure
    from sb3_piano.lab.results.measuring import ACTION_NOISE, SEEDS, is_generated, player_digest
    from sb3_piano.lab.results.records import physics_named
    from sb3_piano.lab.results.tables import scores
    from sb3_piano.music import select_pieces
    from sb3_piano.settings import NotNegative, checked

    if arguments.held_out and (arguments.pieces or arguments.seeds):
        raise ConfigError(
            "--held-out cannot be given with --pieces or --seeds: it has pieces and seeds of its "
            "own. Expected one of them."
        )
    for seed in arguments.seeds or ():
        if arguments.seeds.count(seed) > 1:
            raise ConfigError(
                f"Seed {seed} is given {arguments.seeds.count(seed)} times: expected each seed "
                "once, as its episode would be counted twice."
            )
    physics, file = physics_named(arguments.physics), arguments.out or Path("results.json")
    check_output_file("--out", file)
    for player in arguments.players:
        player_digest(player)  # report unknown players before playing
    if arguments.held_out:
        pieces, seeds = held_out().pieces, held_out().seeds
    else:
        given = arguments.pieces or ["repertoire"]
        made = tuple(piece for piece in given if is_generated(piece))
        others = [piece for piece in given if piece not in made]
        pieces = made + tuple(map(str, select_pieces(others)) if others else ())
        seeds = tuple(arguments.seeds or SEEDS)
    Results.add_to(file, ())  # report an unusable file before playing
    given_noise = ACTION_NOISE if arguments.noise is None else arguments.noise
    noise = checked("--noise", given_noise, NotNegative)
    jobs = [
        Measurement(piece, who, seeds, physics, noise)
        for who in arguments.players
        for piece in pieces
    ]
    for found in _done(arguments, "pieces", measure, jobs):
        Results.add_to(file, [found])
        print(f"{found.piece} by {found.player}: F1 / onset F1 {scores([found])}", flush=True)
    print(f"Results:     {file}")
    return EXIT_OK


def _check(arguments: argparse.Namespace) -> int:
    from sb3_piano.lab.results import Results, check, drawn
    from sb3_piano.settings import Index, NotNegative, checked

    tolerance = checked("--tolerance", arguments.tolerance, NotNegative)
    seed = checked("--seed", arguments.seed, Index)
    if arguments.all and arguments.sample is not None:
        raise ConfigError("--sample cannot be given with --all: expected one of them.")
    results = Results.read(arguments.file).results
    count = None if arguments.all else arguments.sample or _SAMPLE
    chosen = drawn(results, count, seed)
    wrong, elsewhere = 0, set[str]()
    for found in _done(arguments, "results", functools.partial(check, tolerance=tolerance), chosen):
        claimed = found.claimed
        verdict = "holds" if found.holds else "DIFFERS"
        print(f"{verdict:8} {claimed.piece} by {claimed.player}", flush=True)
        for problem in found.problems:
            print(f"         {problem}")
        wrong += not found.holds
        elsewhere |= set(found.differences)
    for difference in sorted(elsewhere):
        print(f"Measured elsewhere: {difference}")
    print(
        f"{len(chosen) - wrong} of {len(chosen)} results that were played again hold, of "
        f"{len(results)} in the file (tolerance {tolerance:g})."
    )
    return _EXIT_DIFFERENT if wrong else EXIT_OK


def _table(arguments: argparse.Namespace) -> int:
    from sb3_piano.lab.results import Results
    from sb3_piano.lab.results.records import physics_named
    from sb3_piano.lab.results.tables import aggregate_table, origin_table, score_table

    physics = physics_named(arguments.physics)
    found = [r for r in Results.read(arguments.file).results if r.physics == physics]
    if not found:
        raise ConfigError(
            f"'{arguments.file}' has no results on the physics {physics!r}: expected another "
            "--physics."
        )
    print(score_table(found), aggregate_table(found), sep="\n\n")
    if arguments.origin:
        print("", origin_table(found), sep="\n")
    return EXIT_OK


def _human(arguments: argparse.Namespace) -> int:
    from sb3_piano.lab.results import human
    from sb3_piano.settings import Positive, checked

    check_output_file("--out", arguments.out)
    seconds = checked("--seconds", arguments.seconds, Positive)
    target = human.TARGETS[arguments.performed]
    found = human.read(arguments.out, seconds)
    pieces = list(human.recordings(arguments.folder, seconds))
    names = {piece.name for piece in pieces}
    people = [human.judge_person(piece) for piece in pieces]
    with progress_bar(arguments, "pieces") as tell:
        tell(completed=0, total=len(pieces) * len(arguments.players))
        for player in arguments.players:
            for piece in pieces:
                key = (piece.name, target, player)
                if key not in found:
                    found[key] = human.judge_player(piece, target, player)
                    human.write(arguments.out, seconds, found.values())
                tell(advance=1)
    players = [j for j in found.values() if j.piece in names and j.player in arguments.players]
    print(human.table([*people, *players], target))
    if players:
        print("", human.differences([*people, *players], target), sep="\n")
    return EXIT_OK


def _done(
    arguments: argparse.Namespace,
    text: str,
    function: Callable[[_Job], _Found],
    jobs: Iterable[_Job],
) -> Iterator[_Found]:
    """Run jobs in processes and yield their results, with a progress bar."""
    from sb3_piano.interrupts import stop_on_signal
    from sb3_piano.jobs import map_jobs, open_executor

    several = list(jobs)
    with (
        progress_bar(arguments, text) as tell,
        stop_on_signal() as request,
        open_executor(arguments.workers) as executor,
    ):
        tell(completed=0, total=len(several))
        for found in map_jobs(executor, function, several, request):
            tell(advance=1)
            yield found
