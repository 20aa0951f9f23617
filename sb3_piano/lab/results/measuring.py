"""Measure players on pieces and return results."""

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
from typing import Any, NamedTuple

import sb3_piano
from sb3_piano.demonstrations import NoisyActions
from sb3_piano.exceptions import PlanWarning
from sb3_piano.lab.music import Corpus
from sb3_piano.lab.results.records import Physics, Result
from sb3_piano.music import load_score, write_midi
from sb3_piano.music.score import digest
from sb3_piano.players import PlayerSpec
from sb3_piano.players.planned import forget_plans
from sb3_piano.threads import processor_label
from sb3_piano.training.playing.player import OpenPlayer
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import model_files
from sb3_piano.unfinished import scratch_folder

PLAYERS: Mapping[str, PlayerSpec] = {
    "planned": PlayerSpec(name="planned"),
    "sampling-32": PlayerSpec(name="sampling", arguments={"samples": 32}),
    "sight-reader": PlayerSpec(name="sight-reader"),
    "sight-reader-tree": PlayerSpec.parse("tree:64x8:sight-reader"),
}
"""The package's players, by their names in files of results."""

GENERATED_DURATION = 20.0
"""Length of generated pieces, s."""

DIGITS = 4
"""Decimals of a score in a file."""

SEEDS = (0, 1, 2, 3, 4)
"""Default seeds."""

ACTION_NOISE = 0.0001
"""Default standard deviation of the noise on actions, rad; see docs/results.md."""

_LIBRARIES = ("mujoco", "numpy", "scipy", "torch")
_GENERATED = re.compile(r"generated-(\d+)-(\d+)")


class Measurement(NamedTuple):
    """Specification of a measurement."""

    piece: str
    player: str
    seeds: tuple[int, ...] = SEEDS
    physics: Physics = "reference"
    action_noise: float = ACTION_NOISE


def is_generated(piece: str) -> bool:
    """Return whether a piece's name is ``generated-SEED-INDEX``, see :func:`score_source`."""
    return _GENERATED.fullmatch(piece) is not None


@contextlib.contextmanager
def score_source(piece: str) -> Iterator[str]:
    """Yield the source of a piece for :func:`~sb3_piano.music.load_score`.

    ``generated-SEED-INDEX`` is an excerpt of 20 s of a corpus of generated music, written to a MIDI
    file; all other names are returned unchanged.
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


def player_of(name: str) -> PlayerSpec:
    """Return the player of a name in a file of results, or of a spec's text.

    Raises:
        ConfigError: If there is no such player.
    """
    return PLAYERS[name] if name in PLAYERS else PlayerSpec.parse(name)


def player_digest(player: str) -> str | None:
    """Return the SHA-256 of the file of a player's network; ``None`` if it has none.

    Raises:
        ConfigError: If the name is neither a player nor a folder.
        RunError: If there is no run in the folder, or it has no model.
    """
    spec = player_of(player)
    if not spec.is_run:
        if spec.file is not None:
            return hashlib.sha256(Path(spec.file).read_bytes()).hexdigest()
        if spec.name != "sight-reader":
            return None
        weights = resources.files("sb3_piano.players") / "sight_reader.safetensors"
        return hashlib.sha256(weights.read_bytes()).hexdigest()
    run = RunFolder.open(spec.name)
    model, _ = model_files(run, run.read_config())
    return hashlib.sha256(model.read_bytes()).hexdigest()


def measure(what: Measurement) -> Result:
    """Measure a player on a piece, with one episode per seed.

    Each seed draws noise on the actions, since playing is chaotic: without noise the last bits of
    sums select one of many possible episodes, and its score says little about the player.

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
    """Play an episode; return its metrics and its CPU time, s."""
    disturbed = None
    if what.action_noise:
        disturbed = functools.partial(NoisyActions, std=what.action_noise)
    spec = player_of(what.player)
    options: Any = {"seed": seed, "physics": what.physics, "score": source, "disturbed": disturbed}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PlanWarning)  # notes that cannot be played as written
        with OpenPlayer.open(spec, **options) as player:  # compiles the scene, once
            start = time.process_time()
            (recording,) = player.play()
            return recording.metrics, time.process_time() - start


def command(what: Measurement) -> str:
    """Return the command that repeats a measurement."""
    parts = ["sb3-piano", "results", "measure", "--pieces", what.piece, "--player", what.player]
    parts += ["--seeds", *map(str, what.seeds)]
    if what.physics != "reference":
        parts += ["--physics", what.physics]
    if what.action_noise != ACTION_NOISE:
        parts += ["--noise", f"{what.action_noise:g}"]
    return shlex.join(parts)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that affect the numbers."""
    found = {name: metadata.version(name) for name in _LIBRARIES}
    return {"python": platform.python_version(), **found}


def hardware() -> str:
    """Return a description of the processor: a name alone may cover different processors."""
    return f"{processor_label()}, {os.cpu_count()} cores"
