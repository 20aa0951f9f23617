"""``sb3-piano play`` and ``report``: video, sound, MIDI and HTML report of a performance."""

from __future__ import annotations

import argparse
import os
import sys
import time
import webbrowser
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    Add,
    check_output_file,
    command,
    env_options,
    print_errors,
    progress_bar,
    refuse_options,
    whole_number,
)
from sb3_piano.cli.losses import HELP as LOSSES_HELP
from sb3_piano.cli.losses import print_losses
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.music import Score
    from sb3_piano.players import PlayerSpec
    from sb3_piano.take import Take
    from sb3_piano.training import EnvSpec, OpenPlayer
    from sb3_piano.training.playing.takes import Planned
    from sb3_piano.viewing import Picture

_SCORE = "score"
"""Name of no player: the piece sounds as written, and the hands rest."""
PLAYERS_HELP = (
    "planned, sight-reader or sampling, also with settings as in sampling:samples=32; a run's "
    "folder; a file of weights; with tree search: tree:64x8:PLAYER"
)
SET_HELP = "environment option, such as physics=fast; repeatable"
_WHAT = (
    "a piece's name or file; a run's folder, or hf:OWNER/NAME on the Hub; or a take, the .npz file "
    "of an earlier play"
)
_REFINE_HELP = (
    "plan the piece, refine the plan in simulation for this time, then play it; the same command "
    "refines the saved plan further"
)
_PEDAL_HELP = (
    "sustain pedal: score (default) as written; none; auto as written or, where nothing is, at "
    "changes of harmony; not for a run"
)
VIEWS = ("stage", "close", "top", "roll")
_VIEW_HELP = (
    "camera: stage (default) from behind with falling notes; close follows the hands; top is from "
    "above; roll shows mostly the notes"
)


def add_arguments(parser: Any) -> None:
    """Add the arguments of ``play``."""
    add = command(parser, _play, epilog=TRUST)
    add(
        "what",
        "PIECE|RUN",
        _WHAT,
    )
    add(
        "--player",
        "PLAYER",
        f"{PLAYERS_HELP}; or score, the piece as written; default: sight-reader",
    )
    add_former_arguments(add)
    add("--out", "DIR", "output folder; default: RUN/play, or play/<title>-<player> for a piece")
    add("--pieces", "PIECE", "another piece for the run's model")
    add("--parts", action="append")
    add("--set", "NAME=VALUE", f"{SET_HELP}; not for a run", action="append")
    add("--seed", "N", "random seed; default: 0", int)
    add("--physics")
    add("--best")
    add("--tree")
    add("--pedal", text=_PEDAL_HELP, choices=("score", "none", "auto"))
    add("--refine", "MINUTES", _REFINE_HELP, minutes)
    add("--report", text="also write an HTML report, report.html")
    add("--losses", text=LOSSES_HELP)
    add("--view", text=_VIEW_HELP, choices=VIEWS, default="stage")
    add("--size", "WxH", "size of the video in pixels", default="854x480")
    add("--human", text="first show it in a window in real time")
    add("--flat", text="equal loudness for all notes; default: by the speed of their keys")
    add("--no-video", text="write only MIDI and sound")
    add("--no-progress")


def add_report_arguments(parser: Any) -> None:
    """Add the arguments of ``report``."""
    add = command(parser, _report, epilog=TRUST)
    add("what", "PIECE|RUN", "a run's folder; a take; a piece's name; or a file such as MIDI")
    add("--player", "PLAYER", "player of the piece, as for play; default: show the notes only")
    default = "default: report.html or piano_roll.html in the folder of the run or piece"
    add("--out", "FILE.html", default, Path)
    add("--seed", "N", "random seed; default: 0", int, 0)
    add("--physics")
    add("--best")
    add("--3d", text="add a 3D replay of the performance", dest="replay")
    add("--open", text="open the report in the web browser")


_FORMER = {"passes": "passes", "plan": "plan", "nominal": "nominal", "horizon": "horizon"}
_FORMER |= {"sampling": "samples", "weights": "model"}
"""Deprecated options, and the player settings that replace them."""


def add_former_arguments(add: Add) -> None:
    """Add hidden deprecated options, now settings of ``--player``."""
    hidden = {"text": argparse.SUPPRESS}
    add("--planned", **hidden)
    add("--reduced", **hidden)
    for name in ("passes", "sampling", "horizon"):
        add(f"--{name}", "N", kind=whole_number, **hidden)
    for name in ("plan", "nominal", "weights"):
        add(f"--{name}", "X", **hidden)


def minutes(text: str) -> float:
    """Parse a number of minutes above 0."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is no number of minutes above 0, such as 5")
    return number


def refine(
    stage: EnvSpec, file: Path, arguments: argparse.Namespace, passes: int | None = None
) -> tuple[Planned, bool]:
    """Plan a piece and refine the plan; return the result and whether Ctrl-C ended it."""
    from sb3_piano.interrupts import stop_on_signal
    from sb3_piano.training.playing.takes import write_plan

    with progress_bar(arguments, "Refining") as tell, stop_on_signal() as request:

        def on_step(done: int, total: int, f1: float) -> None:
            tell(description=f"Refining, F1 {f1:.3f}", completed=done, total=total)

        made = write_plan(
            stage,
            file,
            seed=arguments.seed or 0,
            minutes=arguments.refine,
            passes=passes,
            on_step=on_step,
            should_stop=lambda: request.made,
        )
        return made, request.made


def player_spec(arguments: argparse.Namespace, default: str = "sight-reader") -> PlayerSpec:
    """Return the player of ``--player``, ``--tree`` and deprecated options.

    Raises:
        ConfigError: If there is no such player, or it has no such setting.
    """
    from sb3_piano.players import PlayerSpec, TreeSettings

    given = {new: getattr(arguments, old, None) for old, new in _FORMER.items()}
    given = {name: value for name, value in given.items() if value is not None}
    if getattr(arguments, "planned", False) or given.keys() - {"model"}:
        default = "sampling" if "samples" in given else "planned"
    spec = PlayerSpec.parse(arguments.player or default)
    if given:
        spec = replace(spec, arguments={**spec.arguments, **given})
    tree = getattr(arguments, "tree", None)
    return spec if tree is None else replace(spec, tree=TreeSettings.parse(tree))


def stage_of(arguments: argparse.Namespace, **options: Any) -> EnvSpec:
    """Return the environment of the arguments; ``options`` as in ``stage_for``.

    Raises:
        ConfigError: If there is no such file, or an option is not valid.
        ScoreError: If the file has no such parts.
    """
    from sb3_piano.music import load_score
    from sb3_piano.training.playing.player import stage_for

    _check_piece(arguments.what)
    parts = getattr(arguments, "parts", None)
    options |= env_options(arguments.set or ())
    if parts:
        options["score"] = asdict(load_score(arguments.what, parts))
    if getattr(arguments, "reduced", False):
        options["reduced_action_space"] = True
    if getattr(arguments, "pedal", None) is not None:
        options["pedal"] = arguments.pedal
    if getattr(arguments, "physics", None) is not None:
        options["physics"] = arguments.physics
    return stage_for(arguments.what, **options)


def _check_piece(what: str) -> None:
    from sb3_piano.music.catalogue import is_path

    if is_path(what) and not os.path.exists(what):
        raise ConfigError(
            f"Nothing to play: there is no {what!r}. Expected the folder of a run, a file such as "
            "a MIDI file, or the name of a piece (see 'sb3-piano pieces list')."
        )
    run = Path(what).parent
    if Path(what).is_file() and (run / "config.yml").is_file():
        raise ConfigError(f"{what!r} is a file of a run: expected its folder, {str(run)!r}.")


def play_run(run: str, arguments: argparse.Namespace) -> int:
    """Play with a run's model, write video, sound and MIDI; return the exit status."""
    from sb3_piano.training import OpenPlayer
    from sb3_piano.training.playing.takes import default_folder, take_of
    from sb3_piano.viewing.views import DEFAULT_PICTURE

    with OpenPlayer.open(run) as player:
        take, folder = take_of(player), default_folder(player, None)
    return _write(take, folder, DEFAULT_PICTURE, arguments)


def _play(arguments: argparse.Namespace) -> int:
    from sb3_piano.jobs.folders import unwritable
    from sb3_piano.music.constants import DEFAULT_VELOCITY
    from sb3_piano.take import show_take
    from sb3_piano.viewing.human_renderer import check_screen

    picture = None if arguments.no_video else _picture(arguments)
    if arguments.human:
        check_screen()  # before playing, which may take long
    if arguments.out is not None:
        try:
            Path(arguments.out).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(Path(arguments.out), error) from error
    take, folder = _take(arguments)
    if arguments.flat and take.score is not None:
        notes = tuple(replace(n, velocity=DEFAULT_VELOCITY) for n in take.score.notes)
        take = replace(take, written_score=replace(take.score, notes=notes))
    if arguments.losses:
        print_losses(take.piano.losses())
    if arguments.human:
        show_take(take, view=arguments.view)
    folder = folder if arguments.out is None else Path(arguments.out)
    return _write(take, folder, picture, arguments)


def _write(take: Take, folder: Path, picture: Picture | None, arguments: argparse.Namespace) -> int:
    from sb3_piano.take import write_take
    from sb3_piano.training.playing.takes import FILE_NAME

    if (folder / f"{FILE_NAME}.wav").exists():
        print(f"Note:  the former files in '{folder}' are replaced")
    with progress_bar(arguments, "Video") as tell:

        def on_frame(done: int, total: int) -> None:
            tell(completed=done, total=total)

        played = write_take(take, folder / FILE_NAME, picture, on_frame)
    silent = "no key was pressed, so there is no MIDI file and nothing to hear"
    print(f"MIDI:  {silent if played.midi is None else played.midi}")
    if played.take is not None:
        print(f"Take:  {played.take}")
    print(f"Sound: {played.wav}{_loudness(take)}")
    if played.video is not None:
        print(f"Video: {played.video}")
    if getattr(arguments, "report", False):
        take.save_report(folder / "report.html")
        print(f"Page:  {folder / 'report.html'}")
    return print_errors(*[f"There is no video. {p}" for p in (played.problem,) if p is not None])


def _loudness(take: Take) -> str:
    """Describe the velocities of a take's notes; empty without notes."""
    if take.score is None:
        return ""
    velocities = sorted(note.velocity for note in take.score.notes)
    if velocities[0] == velocities[-1]:
        return f" (all notes of velocity {velocities[0]})"
    source = "as struck" if take.judged else "as written"
    return f" (velocities {velocities[0]} to {velocities[-1]}, {source})"


def _picture(arguments: argparse.Namespace) -> Picture:
    from sb3_piano.viewing import Picture

    width, _, height = arguments.size.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ConfigError(f"--size is {arguments.size!r}: expected pixels such as 640x360.")
    return Picture(width=int(width), height=int(height), view=arguments.view)


def _take(arguments: argparse.Namespace) -> tuple[Take, Path]:
    """Play, or read a take; return it and its default folder."""
    from sb3_piano.music import load_score
    from sb3_piano.take import Take
    from sb3_piano.training.playing.takes import default_folder, folder_of, take_of_score
    from sb3_piano.training.sharing.hub import exported_folder, is_on_hub

    if is_on_hub(arguments.what):
        place = default_folder(None, None) / arguments.what.rpartition("/")[2]
        arguments.what, arguments.out = exported_folder(arguments.what), arguments.out or place
    if arguments.player == _SCORE:
        others = ("planned", *_FORMER, "reduced", "pieces", "seed", "best", "tree", "set", "pedal")
        others += ("refine",)
        refuse_options(arguments, others, f"with --player {_SCORE}: nobody plays.")
        _check_piece(arguments.what)
        written = load_score(arguments.what, arguments.parts or ())
        take = take_of_score(written, physics=arguments.physics or "reference")
        return take, default_folder(None, written)
    if _is_take(arguments.what):
        others = ("player", "planned", *_FORMER, "reduced", "pieces", "parts", "set", "seed")
        reason = f"with the take '{arguments.what}', which was played."
        refuse_options(arguments, (*others, "pedal", "physics", "best", "tree", "refine"), reason)
        take = Take.read(arguments.what)
        return take, folder_of(take)
    opened, score = _opened(arguments)
    with opened as player:
        return _played(player, arguments), default_folder(player, score)


def _is_take(what: str) -> bool:
    return str(what).endswith(".npz") and os.path.isfile(what)


def _opened(arguments: argparse.Namespace) -> tuple[OpenPlayer, Score | None]:
    """Open the player; also return the piece if it is not the run's own."""
    from sb3_piano.music import load_score
    from sb3_piano.players import PlayerSpec
    from sb3_piano.training import OpenPlayer
    from sb3_piano.training.playing.takes import plan_file

    options: dict[str, Any] = {"seed": arguments.seed or 0, "best": arguments.best}
    if os.path.isdir(arguments.what):
        reason = f"with the run '{arguments.what}': its own model plays."
        others = ("player", "planned", *_FORMER, "reduced", "set", "pedal", "refine")
        refuse_options(arguments, others, reason, "Expected a piece.")
        score = None
        if arguments.pieces is None:
            refuse_options(arguments, ("parts",), "without --pieces:", "Expected a file there.")
        else:
            score = load_score(arguments.pieces, arguments.parts or ())
        spec = player_spec(arguments, str(arguments.what))
        return OpenPlayer.open(spec, physics=arguments.physics, score=score, **options), score
    refuse_options(arguments, ("pieces",), f"with a piece, which {arguments.what!r} is.")
    spec = player_spec(arguments)
    if spec.is_run:
        refuse_options(
            arguments, ("set", "pedal"), f"with the run '{spec.name}', which has its own."
        )
        _check_piece(arguments.what)
        score = load_score(arguments.what, arguments.parts or ())
        return OpenPlayer.open(spec, physics=arguments.physics, score=score, **options), score
    stage = stage_of(arguments)
    if arguments.refine is not None:
        refuse_options(arguments, ("player", "planned", *_FORMER), "with --refine: the plan plays.")
        file = plan_file(stage)
        made, _ = refine(stage, file, arguments)
        print(f"Plan:  {file} (F1 {made.before:.3f} before, {made.f1:.3f} refined)")
        spec = PlayerSpec(name="planned", arguments={"plan": str(file)}, tree=spec.tree)
    return OpenPlayer.open(spec, stage, **options), None


def _played(player: OpenPlayer, arguments: argparse.Namespace) -> Take:
    """Play, and print the player and its scores."""
    from sb3_piano.training.playing.takes import take_of

    reads = player.spec.name == "sight-reader"
    began = times = time.perf_counter()
    with progress_bar(arguments, "Reading" if reads else "Planning") as tell:

        def on_step(done: int, total: int) -> None:
            nonlocal times
            times = time.perf_counter() if done == 1 else times
            tell(description="Playing", completed=done, total=total)

        take = take_of(player, on_step)
    if player.run is not None:
        return take
    metrics = take.metrics
    print(
        f"{player.spec}: F1 {metrics['f1']:.3f} (precision {metrics['precision']:.3f}, recall "
        f"{metrics['recall']:.3f}; playing nothing {metrics['noop_f1']:.3f}), onset F1 "
        f"{metrics['onset_f1']:.3f}"
    )
    print(
        f"{'Read' if reads else 'Planned'} in {times - began:.1f} s, "
        f"{take.piano.roll.duration:.1f} s of music played in "
        f"{time.perf_counter() - times:.1f} s"
    )
    if player.piano.goal.adds_pedal:
        print("Pedal: at changes of harmony; the score has none")
    return take


def _report(arguments: argparse.Namespace) -> int:
    from sb3_piano.training import write_report
    from sb3_piano.training.evaluation.report import write_piece_report, write_take_report

    check_output_file("--out", arguments.out)
    is_run = os.path.isdir(arguments.what)
    if _is_take(arguments.what):
        refuse_options(arguments, ("player", "physics", "best"), "with a take, which was played.")
        path = write_take_report(arguments.what, arguments.out, replay=arguments.replay)
    elif is_run or arguments.player is not None:
        if is_run:
            refuse_options(arguments, ["player"], f"with the run '{arguments.what}', which plays.")
        path = write_report(
            arguments.what if is_run else arguments.player,
            arguments.out,
            seed=arguments.seed,
            physics=arguments.physics,
            score=None if is_run else arguments.what,
            best=arguments.best,
            replay=arguments.replay,
        )
    else:
        _check_piece(arguments.what)
        instead = "expected one, or a run."
        refuse_options(arguments, ("physics", "best"), "without --player:", instead)
        if arguments.replay:
            raise ConfigError(f"--3d cannot be given without --player: {instead}")
        path = write_piece_report(arguments.what, arguments.out)
    print(f"Report: {path}")
    if arguments.open and not webbrowser.open(path.resolve().as_uri()):
        print("No web browser could be started: open the file in one.", file=sys.stderr)
    return EXIT_OK
