"""``sb3-piano play``: watch and hear a trained model, a planned pianist, or a piece itself."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import EXIT_ERROR, EXIT_OK, TRUST, add_shared, progress_bar
from sb3_piano.cli.plan import add_planner_arguments, check_planned, planned_take
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.viewing import Picture, Take


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    play = commands.add_parser(
        "play", help="watch and hear a trained model, or a piece", epilog=TRUST
    )
    add = play.add_argument
    add("what", metavar="RUN|PIECE", help="a run's folder; or a file, such as MIDI, or a piece")
    add("--planned", action="store_true", help="let planned hands play the piece, untrained")
    add_planner_arguments(add)
    add("--out", metavar="DIR", help="default: RUN/play, or play/<title> for a piece")
    add("--score", metavar="PIECE", help="let the run's model play another piece")
    add("--seed", type=int, metavar="N", help="seed of the run's environment; default: 0")
    add_shared(add, "--physics")
    add_shared(add, "--best")
    add("--camera", choices=("overview", "topdown"), default="overview", help="default: overview")
    add("--size", default="640x360", metavar="WxH", help="pixels of the video; default: 640x360")
    add("--human", action="store_true", help="show it in a window first, in real time")
    add("--no-video", action="store_true", help="write only the MIDI file and the sound")
    add_shared(add, "--no-progress")
    play.set_defaults(command=_play)


def play_run(run: str, arguments: argparse.Namespace) -> int:
    """Let a run's model play, write what there is to see and hear, and return the exit status."""
    from sb3_piano.training.playing.takes import default_folder, take_of_run
    from sb3_piano.viewing import DEFAULT_PICTURE

    return _write(take_of_run(run), default_folder(run, None), DEFAULT_PICTURE, arguments)


def _play(arguments: argparse.Namespace) -> int:
    from sb3_piano.viewing import check_screen, show_take

    picture = None if arguments.no_video else _picture(arguments)
    if arguments.human:
        check_screen()  # before anything is played, which may take long
    take, folder = _take(arguments)
    if arguments.human:
        show_take(take, camera=arguments.camera)
    return _write(take, folder, picture, arguments)


def _write(take: Take, folder: Path, picture: Picture | None, arguments: argparse.Namespace) -> int:
    from sb3_piano.training.playing.takes import FILE_NAME
    from sb3_piano.viewing import write_take

    with progress_bar(arguments, "Video") as tell:
        played = write_take(
            take,
            folder / FILE_NAME,
            picture,
            lambda done, total: tell(completed=done, total=total),
        )
    silent = "no key was pressed, so there is no MIDI file and nothing to hear"
    print(f"MIDI:  {silent if played.midi is None else played.midi}")
    print(f"Sound: {played.wav}")
    if played.video is not None:
        print(f"Video: {played.video}")
    if played.problem is None:
        return EXIT_OK
    print(f"sb3-piano: error: There is no video. {played.problem}", file=sys.stderr)
    return EXIT_ERROR


def _picture(arguments: argparse.Namespace) -> Picture:
    from sb3_piano.viewing import Picture

    width, _, height = arguments.size.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ConfigError(f"--size is {arguments.size!r}: expected pixels such as 640x360.")
    return Picture(width=int(width), height=int(height), camera=arguments.camera)


def _take(arguments: argparse.Namespace) -> tuple[Take, Path]:
    """Let the run or the piece play; return that, and the folder to write it into."""
    from sb3_piano.music import load_score
    from sb3_piano.training.playing.takes import default_folder, take_of_run, take_of_score

    what, score = arguments.what, None
    check_planned(arguments)
    if arguments.planned:
        _check_piece(arguments, "score", "best")
        return planned_take(arguments)
    if Path(what).is_dir():
        score = None if arguments.score is None else load_score(arguments.score)
        seed = 0 if arguments.seed is None else arguments.seed
        take = take_of_run(
            what, seed=seed, physics=arguments.physics, score=score, best=arguments.best
        )
        folder = default_folder(what, score)
    else:
        _check_piece(arguments, "score", "seed", "best")
        score = load_score(what)
        take = take_of_score(score, physics=arguments.physics or "reference")
        folder = default_folder(None, score)
    return take, folder if arguments.out is None else Path(arguments.out)


def _check_piece(arguments: argparse.Namespace, *of_runs: str) -> None:
    from sb3_piano.music import is_path

    what = arguments.what
    if is_path(what) and not Path(what).exists():
        raise ConfigError(
            f"Nothing to play: there is no {what!r}. Expected the folder of a run, a file such as "
            "a MIDI file, or the name of a piece (see 'sb3-piano pieces list')."
        )
    for name in of_runs:
        if getattr(arguments, name) is not None:
            raise ConfigError(
                f"--{name} cannot be given with a piece, which {what!r} is. Expected a run's "
                f"folder, or no --{name}."
            )
