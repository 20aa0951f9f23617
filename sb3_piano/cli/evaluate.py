"""``sb3-piano evaluate``: scores of trained models and other players, alone or compared."""

from __future__ import annotations

import argparse
from typing import Any

from sb3_piano.cli.common import (
    TRUST,
    adder,
    command,
    print_errors,
    print_interrupted,
    progress_bar,
    whole_number,
)
from sb3_piano.cli.losses import HELP
from sb3_piano.exceptions import SB3PianoError

_PIECES_HELP = "piece to play instead of each run's own: its name, or a file such as MIDI"
_MUSICAL_HELP = "also judge endings, loudness, chords, timing by hand, legato and pedal"
_MOTION_HELP = "also write all motion to performance_<i>.npz beside each MIDI file"


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _evaluate, epilog=TRUST)
    either = adder(parser.add_mutually_exclusive_group())
    who = "a run's folder, or another player (needs --pieces); several are compared"
    add("runs", "RUN|PLAYER", who, nargs="+")
    add("--episodes", "N", "episodes per seed", whole_number, 1)
    either("--seed", "N", "random seed", int, 0)
    either("--seeds", "N", "several random seeds", int, nargs="+")
    add("--pieces", "PIECE", _PIECES_HELP, nargs="+")
    add("--physics")
    add("--best")
    add("--tree")
    add("--motion", text=_MOTION_HELP)
    add("--metric", "NAME", "metrics to show, such as f1 onset_f1 return", nargs="+")
    add("--musical", text=_MUSICAL_HELP)
    add("--losses", text=HELP)
    add("--csv", text="write one row per episode to a CSV file")
    add("--json")
    add("--no-progress")


def evaluate_run(run: str) -> None:
    """Evaluate a run and print the results."""
    from sb3_piano.cli.evaluation_tables import show_one
    from sb3_piano.training import evaluate

    show_one(evaluate(run))


def _evaluate(arguments: argparse.Namespace) -> int:
    from sb3_piano.cli.evaluation_tables import show, show_losses
    from sb3_piano.metrics import DEFINITIONS
    from sb3_piano.metrics.episode import definition_of
    from sb3_piano.metrics.musicianship import MUSICIANSHIP
    from sb3_piano.players import TreeSettings
    from sb3_piano.settings import refuse_unknown
    from sb3_piano.training.evaluation.evaluate import evaluate_runs

    players = arguments.runs
    if arguments.tree is not None:
        players = [f"tree:{TreeSettings.parse(arguments.tree)}:{run}" for run in players]
    named = (n for n in arguments.metric or [] if definition_of(n).section != "Return")
    refuse_unknown(named, DEFINITIONS, "metric")  # reward terms may be of one's own
    asked = not set(MUSICIANSHIP).isdisjoint(arguments.metric or ())
    seeds, scores = arguments.seeds or [arguments.seed], arguments.pieces or []
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
        show(found, arguments.metric)
        if arguments.losses:
            show_losses(found.evaluations)
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
