"""Measuring: pieces are played, and how well becomes a result."""

from __future__ import annotations

import contextlib
import datetime
import functools
import hashlib
import os
import platform
import re
import shlex
import time
import warnings
from collections.abc import Iterator, Mapping
from importlib import metadata, resources
from pathlib import Path
from typing import NamedTuple

import sb3_piano
from sb3_piano.demonstrations import NoisyActions
from sb3_piano.exceptions import ConfigError, PlanWarning
from sb3_piano.lab.music import Corpus
from sb3_piano.lab.results.records import Physics, Result
from sb3_piano.music import digest, load_score, write_midi
from sb3_piano.planning import forget_plans
from sb3_piano.players import TreeSettings
from sb3_piano.threads import processor_label
from sb3_piano.training.playing.player import SavedPlayer, env_to_record
from sb3_piano.training.playing.takes import planner_config, take_of_planner
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import model_files
from sb3_piano.unfinished import scratch_folder


class _Player(NamedTuple):
    algo: str
    arguments: Mapping[str, int] = {}
    tree: TreeSettings | None = None


PLAYERS: Mapping[str, _Player] = {
    "planned": _Player("planned"),
    "sampling-32": _Player("sampling", {"samples": 32}),
    "sight-reader": _Player("sight-reader"),
    "sight-reader-tree": _Player("sight-reader", tree=TreeSettings(simulations=64, depth=8)),
}
"""Algorithm of each player that comes with the package, its arguments and its tree."""

GENERATED_DURATION = 20.0
"""Length of generated pieces, s."""

DIGITS = 4
"""Decimals of a score in a file."""

SEEDS = (0, 1, 2, 3, 4)
"""What is played with by default."""

ACTION_NOISE = 0.0001
"""Standard deviation of the noise on actions by default, rad: see docs/results.md."""

_LIBRARIES = ("mujoco", "numpy", "scipy", "torch")
_GENERATED = re.compile(r"generated-(\d+)-(\d+)")


class Measurement(NamedTuple):
    """What is to be measured."""

    piece: str
    player: str
    seeds: tuple[int, ...] = SEEDS
    physics: Physics = "reference"
    action_noise: float = ACTION_NOISE


def is_generated(piece: str) -> bool:
    """Return whether a piece is called ``generated-SEED-INDEX``, see :func:`score_source`."""
    return _GENERATED.fullmatch(piece) is not None


@contextlib.contextmanager
def score_source(piece: str) -> Iterator[str]:
    """Give what :func:`~sb3_piano.music.load_score` reads as the piece of this name.

    ``generated-SEED-INDEX`` is an excerpt of 20 s of a corpus of generated music, by way of a MIDI
    file; all others are names and files of pieces already.
    """
    made = _GENERATED.fullmatch(piece)
    if made is None:
        yield piece
        return
    seed, index = map(int, made.groups())
    corpus = Corpus(seed=seed, n=index + 1, duration=GENERATED_DURATION, sources={"generated": 1.0})
    with scratch_folder() as folder:
        file = Path(folder, f"{piece}.mid")
        write_midi(corpus[index], file)
        yield str(file)


def score_digest(piece: str) -> str:
    """Return the digest of a piece by its name."""
    with score_source(piece) as source:
        return digest(load_score(source))


def player_digest(player: str) -> str | None:
    """Return the SHA-256 of the file of a player's network; ``None`` if it has none.

    Raises:
        ConfigError: If the name is no player's and no folder.
        RunError: If there is no run in the folder, or it has no model.
    """
    if player in PLAYERS:
        if PLAYERS[player].algo != "sight-reader":
            return None
        weights = resources.files("sb3_piano.players") / "sight_reader.safetensors"
        return hashlib.sha256(weights.read_bytes()).hexdigest()
    if not os.path.isdir(player):
        raise ConfigError(
            f"There is no player {player!r}: expected one of {', '.join(PLAYERS)}, or the folder "
            "of a run."
        )
    run = RunFolder.open(player)
    model, _ = model_files(run, run.read_config())
    return hashlib.sha256(model.read_bytes()).hexdigest()


def measure(what: Measurement) -> Result:
    """Return how well a player plays a piece, one episode for each seed.

    The seed draws noise on the actions, since playing is chaotic: one episode without noise is one
    of many that the last bits of sums choose from, and says little of how well the piece is played.

    Raises:
        ConfigError: If there is no such player.
        RunError: If a run cannot be played, or cannot play the piece.
        ScoreError: If there is no such piece.
    """
    weights = player_digest(what.player)
    forget_plans()
    with score_source(what.piece) as source:
        score_sha256 = digest(load_score(source))
        played, seconds = zip(*(_play(source, what, seed) for seed in what.seeds), strict=True)
    return Result(
        piece=what.piece,
        score_sha256=score_sha256,
        player=what.player,
        player_sha256=weights,
        physics=what.physics,
        seeds=what.seeds,
        action_noise=what.action_noise,
        f1=tuple(round(metrics["f1"], DIGITS) for metrics in played),
        onset_f1=tuple(round(metrics["onset_f1"], DIGITS) for metrics in played),
        noop_f1=round(played[0]["noop_f1"], DIGITS),
        cpu_seconds=round(seconds[0], 1),
        package_version=sb3_piano.__version__,
        versions=versions(),
        hardware=hardware(),
        command=command(what),
        date=datetime.datetime.now(datetime.UTC).date(),
    )


def _play(source: str, what: Measurement, seed: int) -> tuple[Mapping[str, float], float]:
    """Return the metrics of an episode, and the time of the processor that it took, s."""
    disturbed = None
    if what.action_noise:
        disturbed = functools.partial(NoisyActions, std=what.action_noise)
    if what.player not in PLAYERS:
        with SavedPlayer.open(
            what.player, seed=seed, physics=what.physics, score=source, disturbed=disturbed
        ) as player:
            start = time.process_time()
            (recording,) = player.play()
            return recording.metrics, time.process_time() - start
    algo, arguments, tree = PLAYERS[what.player]
    config = planner_config(
        source, algo, seed=seed, env_kwargs={"physics": what.physics}, **arguments
    )
    env_to_record(config).close()  # compiles the scene, once in a process
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PlanWarning)  # notes that cannot be played as written
        metrics = take_of_planner(config, tree=tree, innermost=disturbed).metrics
    return metrics, time.process_time() - start


def command(what: Measurement) -> str:
    """Return the command that measures one result again."""
    parts = ["sb3-piano", "results", "measure", "--pieces", what.piece, "--players", what.player]
    parts += ["--seeds", *map(str, what.seeds)]
    if what.physics != "reference":
        parts += ["--physics", what.physics]
    if what.action_noise != ACTION_NOISE:
        parts += ["--noise", f"{what.action_noise:g}"]
    return shlex.join(parts)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries on which the numbers depend."""
    found = {name: metadata.version(name) for name in _LIBRARIES}
    return {"python": platform.python_version(), **found}


def hardware() -> str:
    """Return the processor in words: its names are shared by those that compute differently."""
    return f"{processor_label()}, {os.cpu_count()} cores"
