"""HTML reports of a player's performance and training, and of a piece's notes."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import RunError
from sb3_piano.files import write_text
from sb3_piano.links import make_folder
from sb3_piano.music import Score, load_score
from sb3_piano.music.difficulty import features
from sb3_piano.music.fingering import apply_fingering
from sb3_piano.players import PlayerSpec
from sb3_piano.take import Take
from sb3_piano.training.playing.player import OpenPlayer, Source
from sb3_piano.training.playing.takes import default_folder, folder_of
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.provenance import provenance
from sb3_piano.viewing.report import Curve, score_html
from sb3_piano.viewing.report.replay import player_script

Texts = list[tuple[str, str]]


def write_report(
    player: PlayerSpec | str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    seed: int = 0,
    physics: str | None = None,
    score: Source | None = None,
    best: str | None = None,
    replay: bool = False,
) -> Path:
    """Play with a saved run or another player, and write an HTML report.

    The file is self-contained and needs no network. The resting hands use the same seed. With
    ``replay`` the page has a 3D replay of the performance. By default the file is
    ``evaluation/report.html`` in the run's folder, or ``report.html`` in the default folder of
    :func:`~sb3_piano.training.play_run`, which has the same arguments and errors.

    Raises:
        ConfigError: If the package was installed without the player of replays.
    """
    if replay:
        player_script()  # raise its error before playing
    with OpenPlayer.open(player, seed=seed, physics=physics, score=score, best=best) as opened:
        if not isinstance(opened.env, PianoEnv):
            raise RunError(
                f"{opened.named} has no music to show: its environment {opened.env_spec.id!r} is "
                "no piano. Expected a run of a piano environment."
            )
        (take,), baseline = opened.play(), opened.rest()
        given = {"--physics": physics, "--best": best, "--pieces": _text_of(score)}
        where = take.scene_options["physics"]
        facts, commands = _origin(opened, where, seed, given, replay)
        trained = f" after {opened.num_timesteps:,} steps of training" if opened.run else ""
        about = {
            "subtitle": f"{opened.algo.upper()}{trained} · {where} physics · seed {seed}",
            "facts": facts,
            "commands": commands,
            "baseline": None if baseline is None else baseline.metrics,
            "labels": {n: term.label for n, term in opened.env.config.terms.items()},
            "curves": {} if opened.run is None else training_curves(opened.run),
        }
        own = default_folder(opened, None) if opened.run is None else opened.run.evaluation_dir
    path = own / "report.html" if out is None else Path(out)
    with _writing(path, own_folder=out is None):
        take.save_report(path, replay=replay, **about)
    return path


def write_take_report(
    file: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    replay: bool = False,
) -> Path:
    """Write an HTML report of a take's file, as :func:`write_report` does for a player.

    Raises:
        ConfigError: If it is no take, or the package was installed without the player of replays.
        RunError: If the take has only motion, as in files of version 0.2.
    """
    take = Take.read(file)
    again = ["sb3-piano", "report", os.fspath(file), *(["--3d"] if replay else [])]
    path = folder_of(take) / "report.html" if out is None else Path(out)
    with _writing(path, own_folder=out is None):
        take.save_report(path, replay=replay, commands=[("This report", shlex.join(again))])
    return path


def _text_of(score: Source | None) -> str | None:
    if isinstance(score, Score):
        return score.title
    return None if score is None else os.fspath(score)


def write_piece_report(name: str, out: str | os.PathLike[str] | None = None) -> Path:
    """Write the piano roll of a piece, or of a file such as MIDI, into an HTML file.

    Notes without a finger get one, as in the environments. The default file is
    ``play/<title>/piano_roll.html``, beside the files of ``sb3-piano play``.

    Raises:
        ScoreError: If the piece is unknown, cannot be read, or is unplayable by hands.
        RunError: If the file cannot be written.
    """
    score = apply_fingering(load_score(name), "ergonomic")
    known = dataclasses.asdict(features(score))
    facts = [("Piece", name)]
    for feature, value in known.items():
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        facts.append((feature.replace("_", " ").capitalize(), text))
    path = default_folder(None, score) / "piano_roll.html" if out is None else Path(out)
    with _writing(path, own_folder=out is None):
        write_text(path, score_html(score, facts))
    return path


@contextlib.contextmanager
def _writing(path: Path, *, own_folder: bool) -> Iterator[None]:
    """Make the folder of a page; convert errors of writing to RunError."""
    try:
        if own_folder:
            make_folder(path.parent)
        yield
    except OSError as error:
        raise RunError(
            f"'{path}' cannot be written: {error.strerror}. Expected a file in an existing folder."
        ) from error


def training_curves(run: RunFolder) -> dict[str, Curve]:
    """Read the curves of a run's TensorBoard files by name, without empty ones.

    A run resumed from a checkpoint before its last log line logged some steps twice; only the
    later values are kept. Numbers that are not finite are left out.
    """
    if not run.tensorboard_dir.is_dir():
        return {}
    # Imported here as it is slow.
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events: dict[str, list[Any]] = {}
    for folder in sorted(run.tensorboard_dir.iterdir()):
        log = EventAccumulator(str(folder), size_guidance={"scalars": 0}).Reload()  # 0: keep all
        for name in log.Tags()["scalars"]:
            events.setdefault(name, []).extend(log.Scalars(name))
    curves = {name: _curve(found) for name, found in events.items()}
    return {name: curve for name, curve in curves.items() if len(curve.steps)}


def _curve(events: list[Any]) -> Curve:
    """Return the curve of a number from the TensorBoard events of all its files."""
    kept: list[Any] = []
    for event in sorted(events, key=lambda event: event.wall_time):
        while kept and kept[-1].step >= event.step:
            kept.pop()
        kept.append(event)
    finite = [event for event in kept if math.isfinite(event.value)]
    return Curve(
        steps=np.array([event.step for event in finite], dtype=np.int64),
        values=np.array([event.value for event in finite], dtype=float),
    )


def _origin(
    player: OpenPlayer,
    physics: str,
    seed: int,
    options: Mapping[str, str | None],
    replay: bool,
) -> tuple[Texts, Texts]:
    """Return the facts of a report, and the commands that reproduce it."""
    notes = {} if player.run is None else player.run.read_provenance()
    now = provenance(seed)
    best = options["--best"]
    who = str(player.spec if player.run is None else player.run.path)
    facts = {
        "Piece": player.piece,
        "Environment": player.env_spec.id,
        "Algorithm" if player.run else "Player": player.algo if player.run else who,
        "Steps trained": f"{player.num_timesteps:,}",
        "Physics": physics,
        "Seed": str(seed),
        "Played": now["created"],
        "Played with": _versions(now["versions"]),
    }
    if player.piano.goal.adds_pedal:
        facts["Pedal"] = "at changes of harmony; the score has none"
    if player.run is not None:
        facts |= {
            "Model": "the last one" if best is None else f"best by {best}",
            "Seed": f"{seed} (of the training: {notes.get('seed', 'unknown')})",
            "Run": who,
            "Trained": str(notes.get("created", "unknown")),
            "Trained with": _versions(notes.get("versions")),
        }
    again = ["sb3-piano", "report", who, "--seed", str(seed)]
    for option, value in options.items():
        again += [] if value is None else [option, value]
    again += ["--3d"] if replay else []
    commands = [("This report", shlex.join(again))]
    if player.run is not None:
        commands.insert(0, ("Training", str(notes.get("command", "unknown"))))
    return list(facts.items()), commands


def _versions(versions: object) -> str:
    if not isinstance(versions, Mapping):
        return "unknown"
    return ", ".join(f"{name} {version}" for name, version in versions.items() if version)
