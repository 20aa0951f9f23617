"""``sb3-piano play`` and ``report``: what a model, a plan or a piece plays."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
import webbrowser
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    Add,
    check_output_file,
    command,
    progress_bar,
    refuse_options,
    tell_errors,
    whole_number,
)
from sb3_piano.cli.losses import HELP as LOSSES_HELP
from sb3_piano.cli.losses import print_losses
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.training import PlannedConfig
    from sb3_piano.viewing import Picture, Take

_OF_SAMPLING = ("nominal", "horizon")
_PLANNED, _SAMPLING, _SIGHT_READER = PLAYERS = ("planned", "sampling", "sight-reader")
"""What plays any piece at once, by the names of :data:`sb3_piano.players.PLAYERS`."""
_SCORE = "score"
"""Stands for no player: the piece is heard as it is written, while the hands rest."""
_TAKES = {
    _PLANNED: ("passes", "plan"),
    _SAMPLING: ("passes", "plan", "sampling", *_OF_SAMPLING),
    _SIGHT_READER: ("weights",),
}
"""The options that each of them has, and no other."""
PLAYER_OPTIONS = ("player", *_TAKES[_SAMPLING], "reduced", "weights")
"""The options of :func:`add_player_arguments`, by the names of their values."""
_PASSES_HELP = "play the plan N times in a simulation first, and try otherwise what goes wrong"
_PLAN_HELP = "follow the plan of a file, such as the plan.npz of a run that 'plan --refine' made"
_SAMPLING_HELP = "let predictive sampling try N ways on from each control step, and play the best"
_PLAYER_HELP = (
    "who plays the piece, untrained on it: planned hands, those with sampling, or a learned "
    "network that plans nothing"
)
_PLAYERS_HELP = f"{_PLAYER_HELP} (the default); or score: the keys go down by themselves"
WEIGHTS_HELP = (
    "of the sight-reader: another network than the package's, as a file, or a folder with a "
    "hand.safetensors such as export writes"
)
VIEWS = ("stage", "close", "top", "roll")
_VIEW_HELP = (
    "from behind the pianist with falling notes (the default), close to the hands and along with "
    "them, from above, or mostly the notes"
)


def add_arguments(parser: Any) -> None:
    """Add the arguments of ``play``."""
    add = command(parser, _play, epilog=TRUST)
    add("what", "RUN|PIECE", "a run's folder, or hf:OWNER/NAME of the Hub; or a piece or a file")
    add("--planned", text="the same as --player planned, or sampling if --sampling is given")
    add_player_arguments(add, (*PLAYERS, _SCORE), _PLAYERS_HELP)
    add("--out", "DIR", "default: RUN/play, or play/<title>-<player> for a piece")
    add("--score", "PIECE", "let the run's model play another piece")
    add("--parts", action="append")
    add("--seed", "N", "seed of the run's environment; default: 0", int)
    add("--physics")
    add("--best")
    add("--tree")
    add("--losses", text=LOSSES_HELP)
    add("--view", text=_VIEW_HELP, choices=VIEWS, default="stage")
    add("--size", "WxH", "pixels of the video", default="854x480")
    add("--human", text="show it in a window first, in real time")
    add("--flat", text="make all notes equally loud; default: as their keys were struck")
    add("--no-video", text="write only the MIDI file and the sound")
    add("--no-progress")


def add_report_arguments(parser: Any) -> None:
    """Add the arguments of ``report``."""
    add = command(parser, _report, epilog=TRUST)
    add("what", "RUN|PIECE", "a run's folder; or a file, such as MIDI, or a piece")
    default = "default: RUN/evaluation/report.html, or play/<title>/piano_roll.html"
    add("--out", "FILE.html", default, Path)
    add("--seed", "N", "of a run; default: 0", int)
    add("--physics")
    add("--best")
    add("--3d", text="show a run's performance in three dimensions, too", dest="replay")
    add("--open", text="open it in the web browser")


def add_player_arguments(
    add: Add, players: Sequence[str] = PLAYERS, text: str = _PLAYER_HELP
) -> None:
    """Add what ``plan`` and ``play --player`` take: who plays, and with which joints."""
    add("--player", text=text, choices=players)
    add("--passes", "N", _PASSES_HELP, whole_number)
    add("--plan", "FILE", _PLAN_HELP)
    add("--sampling", "N", _SAMPLING_HELP, whole_number)
    nominal = "what these ways change: plan (default), or none for sampling from zero"
    add("--nominal", "WHAT", nominal)
    add("--horizon", "H", "control steps that sampling looks ahead", whole_number)
    add("--reduced", text="the reduced action space, not all joints; not of the sight-reader")
    add("--weights", "FILE", WEIGHTS_HELP)


def play_run(run: str, arguments: argparse.Namespace) -> int:
    """Let a run's model play, write what there is to see and hear, and return the exit status."""
    from sb3_piano.training.playing.takes import default_folder, take_of_run
    from sb3_piano.viewing import DEFAULT_PICTURE

    return _write(take_of_run(run), default_folder(run, None), DEFAULT_PICTURE, arguments)


def _play(arguments: argparse.Namespace) -> int:
    from sb3_piano.jobs.folders import unwritable
    from sb3_piano.music.constants import DEFAULT_VELOCITY
    from sb3_piano.viewing import check_screen, show_take

    picture = None if arguments.no_video else _picture(arguments)
    if arguments.human:
        check_screen()  # before anything is played, which may take long
    if arguments.out is not None:
        try:
            Path(arguments.out).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(Path(arguments.out), error) from error
    take, folder = _take(arguments)
    if arguments.flat and take.score is not None:
        notes = tuple(replace(n, velocity=DEFAULT_VELOCITY) for n in take.score.notes)
        take = replace(take, score=replace(take.score, notes=notes))
    if arguments.losses:
        print_losses(take.performance.losses())
    if arguments.human:
        show_take(take, view=arguments.view)
    folder = folder if arguments.out is None else Path(arguments.out)
    return _write(take, folder, picture, arguments)


def _write(take: Take, folder: Path, picture: Picture | None, arguments: argparse.Namespace) -> int:
    from sb3_piano.training.playing.takes import FILE_NAME
    from sb3_piano.viewing import write_take

    with progress_bar(arguments, "Video") as tell:

        def on_frame(done: int, total: int) -> None:
            tell(completed=done, total=total)

        played = write_take(take, folder / FILE_NAME, picture, on_frame)
    silent = "no key was pressed, so there is no MIDI file and nothing to hear"
    print(f"MIDI:  {silent if played.midi is None else played.midi}")
    print(f"Sound: {played.wav}{_loudness(take)}")
    if played.video is not None:
        print(f"Video: {played.video}")
    return tell_errors(*[f"There is no video. {p}" for p in (played.problem,) if p is not None])


def _loudness(take: Take) -> str:
    """Return in words how loud the notes of a take are; nothing if there are none."""
    if take.score is None:
        return ""
    velocities = sorted(note.velocity for note in take.score.notes)
    if velocities[0] == velocities[-1]:
        return f" (all notes of velocity {velocities[0]})"
    source = "as struck" if take.mark_sounding else "as written"
    return f" (velocities {velocities[0]} to {velocities[-1]}, {source})"


def _picture(arguments: argparse.Namespace) -> Picture:
    from sb3_piano.viewing import Picture

    width, _, height = arguments.size.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ConfigError(f"--size is {arguments.size!r}: expected pixels such as 640x360.")
    return Picture(width=int(width), height=int(height), view=arguments.view)


def _take(arguments: argparse.Namespace) -> tuple[Take, Path]:
    """Let the run or the piece play; return that, and the folder that it belongs into."""
    from sb3_piano.music import load_score
    from sb3_piano.training.playing.takes import default_folder, take_of_score
    from sb3_piano.training.sharing.hub import exported_folder, is_on_hub

    if is_on_hub(arguments.what):
        place = default_folder(None, None) / arguments.what.rpartition("/")[2]
        arguments.what, arguments.out = exported_folder(arguments.what), arguments.out or place
    if os.path.isdir(arguments.what):
        return _take_of_run(arguments)
    if arguments.player != _SCORE:
        _check_piece(arguments, "score", "best")
        if not arguments.planned and arguments.player is None:
            arguments.player = _SIGHT_READER
        return _played_take(arguments)
    _check_piece(arguments, "score", "seed", "best", "tree")
    others = [name for name in PLAYER_OPTIONS if name != "player"]
    refuse_options(arguments, ("planned", *others), f"with --player {_SCORE}: nobody plays.")
    score = load_score(arguments.what, arguments.parts or ())
    take = take_of_score(score, physics=arguments.physics or "reference")
    return take, default_folder(None, score)


def _take_of_run(arguments: argparse.Namespace) -> tuple[Take, Path]:
    """Let a run's model play; return that, and the folder that it belongs into."""
    from sb3_piano.music import load_score
    from sb3_piano.players import TreeSettings
    from sb3_piano.training.playing.takes import default_folder, take_of_run

    what = arguments.what
    reason = f"with the run '{what}': its own model plays."
    refuse_options(arguments, ("planned", *PLAYER_OPTIONS), reason, "Expected a piece.")
    score = None
    if arguments.score is None:
        refuse_options(arguments, ("parts",), "without --score:", "Expected a file there.")
    else:
        score = load_score(arguments.score, arguments.parts or ())
    take = take_of_run(
        what,
        seed=arguments.seed or 0,
        physics=arguments.physics,
        score=score,
        best=arguments.best,
        tree=None if arguments.tree is None else TreeSettings.parse(arguments.tree),
    )
    return take, default_folder(what, score)


def _check_piece(arguments: argparse.Namespace, *of_runs: str) -> None:
    from sb3_piano.music import is_path

    what = arguments.what
    if is_path(what) and not os.path.exists(what):
        raise ConfigError(
            f"Nothing to play: there is no {what!r}. Expected the folder of a run, a file such as "
            "a MIDI file, or the name of a piece (see 'sb3-piano pieces list')."
        )
    run = Path(what).parent
    if Path(what).is_file() and (run / "config.yml").is_file():
        raise ConfigError(f"{what!r} is a file of a run: expected its folder, {str(run)!r}.")
    refuse_options(arguments, of_runs, f"with a piece, which {what!r} is.")


def _played_take(arguments: argparse.Namespace) -> tuple[Take, Path]:
    """Let a player play a piece, say how well, and return that and the folder for it."""
    from sb3_piano.music import load_score
    from sb3_piano.players import TreeSettings
    from sb3_piano.training.playing.takes import default_folder, take_of_planner

    physics = arguments.physics
    options: dict[str, Any] = {} if physics is None else {"physics": physics}
    if arguments.parts:
        options["score"] = asdict(load_score(arguments.what, arguments.parts))
    config = player_config(arguments, arguments.seed or 0, options)
    reads = config.algo == _SIGHT_READER
    with progress_bar(arguments, "Reading" if reads else "Planning") as tell:

        def on_step(done: int, total: int) -> None:
            tell(**({"description": "Playing", "completed": done, "total": total} if done else {}))

        tree = None if arguments.tree is None else TreeSettings.parse(arguments.tree)
        played = take_of_planner(config, on_step, tree=tree)
    metrics, roll = played.metrics, played.take.performance.roll
    print(
        f"F1 {metrics['f1']:.3f} (precision {metrics['precision']:.3f}, recall "
        f"{metrics['recall']:.3f}; playing nothing {metrics['noop_f1']:.3f}), onset F1 "
        f"{metrics['onset_f1']:.3f}"
    )
    done = "Read" if reads else "Planned"
    print(
        f"{done} in {played.planning:.1f} s, {roll.duration:.1f} s of music "
        f"played in {played.playing:.1f} s"
    )
    folder = default_folder(None, played.score)
    by = config.algo if arguments.tree is None else f"{config.algo}-tree"
    return played.take, folder.with_name(f"{folder.name}-{by}")


def player_config(
    arguments: argparse.Namespace, seed: int, options: dict[str, Any]
) -> PlannedConfig:
    """Return the settings of the player that the arguments stand for."""
    from sb3_piano.training.playing.takes import planner_config

    player = _player(arguments)
    if arguments.reduced:
        options["reduced_action_space"] = True
    if player == _SIGHT_READER:
        weights = {} if arguments.weights is None else {"model": arguments.weights}
        return planner_config(arguments.what, player, seed=seed, env_kwargs=options, **weights)
    given = {name: getattr(arguments, name) for name in ("plan", *_OF_SAMPLING)}
    if arguments.nominal == "none":
        refuse_options(arguments, ["passes", "plan"], "with --nominal none: no plan is followed.")
    if arguments.plan is not None:
        refuse_options(arguments, ["passes"], "with --plan: that plan is followed as it is.")
    plan = None if arguments.passes is None else {"passes": arguments.passes}
    given["settings" if player == _PLANNED else "plan_settings"] = plan
    given["samples"] = arguments.sampling
    given = {name: value for name, value in given.items() if value is not None}
    return planner_config(arguments.what, player, seed=seed, env_kwargs=options, **given)


def _player(arguments: argparse.Namespace) -> str:
    """Return who plays, without options of others."""
    named = arguments.player
    if named is not None and hasattr(arguments, "planned"):
        refuse_options(arguments, ["planned"], f"with --player {named}:", "expected one of them.")
    player: str = named or (_PLANNED if arguments.sampling is None else _SAMPLING)
    if named is None and player == _PLANNED:
        reason = "without --sampling: a plan is followed as it is."
        refuse_options(arguments, _OF_SAMPLING, reason, "Expected --sampling N, too.")
    for other, taken in _TAKES.items():
        instead = f"expected --player {other}, or none of its options."
        foreign = [name for name in taken if name not in _TAKES[player]]
        refuse_options(arguments, foreign, f"to the player {player!r}:", instead)
    return player


def _report(arguments: argparse.Namespace) -> int:
    from sb3_piano.training import write_piece_report, write_report

    check_output_file("--out", arguments.out)
    if os.path.isdir(arguments.what):
        path = write_report(
            arguments.what,
            arguments.out,
            seed=arguments.seed or 0,
            physics=arguments.physics,
            best=arguments.best,
            replay=arguments.replay,
        )
    else:
        _check_piece(arguments, "seed", "physics", "best")
        if arguments.replay:
            raise ConfigError(
                "--3d shows how a run plays: expected a run's folder, not a piece. "
                f"'sb3-piano plan {shlex.quote(arguments.what)}' makes one."
            )
        path = write_piece_report(arguments.what, arguments.out)
    print(f"Report: {path}")
    if arguments.open and not webbrowser.open(path.resolve().as_uri()):
        print("No web browser could be started: open the file in one.", file=sys.stderr)
    return EXIT_OK
