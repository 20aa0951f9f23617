"""The making of a corpus: by any executor, gone on with, the same whoever makes it."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shlex
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from sb3_piano.demonstrations.corpus import DATA, INDEX, RecordedCorpus
from sb3_piano.demonstrations.dataset import forget_unfinished, require_minari
from sb3_piano.demonstrations.shards import (
    Shard,
    file_digest,
    make_missing,
    making,
)
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.files import write_json
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Outcome, begin_or_go_on, process_pool, status
from sb3_piano.jobs.folders import shared_folder
from sb3_piano.links import make_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.music import digest
from sb3_piano.music.library import Library
from sb3_piano.pipelines.corpus_settings import CorpusConfig
from sb3_piano.pipelines.performances import CorpusJob, open_player
from sb3_piano.players import PlayerSpec
from sb3_piano.players.hand_model import FILE_NAME
from sb3_piano.training.configuration.env_spec import BASE
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.provenance import provenance
from sb3_piano.training.runs.saved import model_files

_CONFIG = "corpus.yml"


@dataclass(frozen=True, kw_only=True)
class PlayedSo:
    """How well a player played with a noise."""

    player: str
    """The player."""
    noise: float
    """Standard deviation of the noise, rad."""
    episodes: int
    """Performances."""
    f1: float
    """Mean F1."""
    onset_f1: float
    """Mean onset F1."""


def record_corpus(
    config: CorpusConfig,
    folder: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    on_progress: Callable[[int, int], object] = lambda done, total: None,
) -> RecordedCorpus | None:
    """Record a corpus of performances, or go on recording it.

    A folder in which it was begun is gone on with: shards that are whole are kept, those that are
    missing or damaged are made. The result is the same whoever makes it, in whatever order, on
    processors of one kind with packages of the same versions.

    ============== ================================================================================
    ``corpus.yml`` the settings, and checksums of the files that are played or that play
    ``run.yml``    command line, versions of packages, time
    ``data/``      Minari data sets, and a manifest of each, a :class:`Shard`
    ``index.json`` when all are there: their names and contents, and a checksum of those
    ============== ================================================================================

    Args:
        config: The settings.
        folder: Where to: a new or empty folder, or one to go on with.
        executor: Makes the shards, where it sees folder and files by the same paths; by default a
            pool of processes of this machine.
        workers: Processes of that pool; by default one for each usable core.
        on_progress: Is told how many performances are over, and of how many.

    Returns:
        The corpus; ``None`` if Ctrl-C or SIGTERM ended it early.

    Raises:
        ConfigError: If a setting is not valid, or a player cannot play.
        RunError: If the folder cannot be used, or has other settings.
        MissingPackageError: If Minari is not installed.
    """
    require_minari()
    place = shared_folder(folder)
    _check_players(config)
    owned = hold(place / LOCK_SUFFIX, f"'{place}' is being worked in", "one recording in a folder.")
    pool = process_pool(workers) if executor is None else contextlib.nullcontext(executor)
    with owned, stop_on_signal():
        inputs = _inputs(config)
        settings = {**config.to_mapping(), "files": inputs}
        begin_or_go_on(place / _CONFIG, "corpus", settings, notes=provenance(config.seed))
        make_folder(place / DATA)
        forget_unfinished(place / DATA)

        def tell(done: int, total: int) -> None:
            on_progress(min(done * config.shard, len(config)), len(config))

        again = f"give the same command again, for {shlex.quote(str(place))}"
        try:
            with pool as chosen:
                shards = make_missing(chosen, _shards(config, inputs, place), tell, again)
        except KeyboardInterrupt:
            return None
        if not any(shard.steps for shard in shards):
            why = next(iter(shards[0].skipped.values()))
            raise RunError(f"Nothing could be played: {why}")
        _write_index(place, config, shards)
    return RecordedCorpus.open(place)


def corpus_status(config: CorpusConfig, folder: str | os.PathLike[str]) -> list[Outcome]:
    """Return how far each shard of a corpus is, also while it is being recorded."""
    return status(making(_shards(config, _inputs(config), shared_folder(folder))))


def _shards(config: CorpusConfig, inputs: Mapping[str, str], place: Path) -> list[CorpusJob]:
    count = -(-len(config) // config.shard)
    return [CorpusJob(config, inputs, number, place / DATA) for number in range(count)]


def summary(shards: Sequence[Shard]) -> list[PlayedSo]:
    """Return how well each player played with each noise, in the order in which they come."""
    found: dict[tuple[str, float], list[Any]] = defaultdict(list)
    for shard in shards:
        for notes in shard.episodes:
            found[str(notes["player"]), float(notes["noise"])].append(notes)
    return [
        PlayedSo(
            player=player,
            noise=noise,
            episodes=len(episodes),
            f1=fmean(notes["f1"] for notes in episodes),
            onset_f1=fmean(notes["onset_f1"] for notes in episodes),
        )
        for (player, noise), episodes in found.items()
    ]


def _check_players(config: CorpusConfig) -> None:
    """Open each player once, so that what is wrong with it is told now and not by a worker."""
    spaces = None
    for name in config.players:
        with open_player(config, name) as (_, env):
            own = env.observation_space, env.action_space
            if spaces not in (None, own):
                raise ConfigError(
                    f"The player {name!r} observes {own[0]} and plays {own[1]}, "
                    f"{config.players[0]!r} other: expected players that see and do the same, or a "
                    "corpus for each."
                )
            spaces = own


def _inputs(config: CorpusConfig) -> dict[str, str]:
    """Return the checksums of what is played or plays, by its name.

    Of an imported piece it is that of its notes: each account keeps files of its own.
    """
    library = Library()
    imported = set(library.names())
    notes = {name: digest(library.score(name)) for name in config.pieces if name in imported}
    files = [Path(name) for name in config.pieces if name not in imported]
    for text in config.players:
        player = PlayerSpec.parse(text)
        if player.is_run:
            files += files_of_a_run(RunFolder.open(player.name))
        elif player.file is not None:
            files.append(_network_file(player.file))
    return notes | {str(file): file_digest(file) for file in files if os.path.isfile(file)}


def files_of_a_run(run: RunFolder) -> list[Path]:
    """Return the files that decide how a run plays, those of what it corrects included."""
    config = run.read_config()
    files = [run.config_file, *filter(None, model_files(run, config))]
    for option, text in config.files.items():
        files += files_of_a_run(RunFolder.open(text)) if option == BASE else [_network_file(text)]
    return files


def _network_file(text: str) -> Path:
    """Return the file that a text names, or that of the network in the folder that it names."""
    path = Path(text)
    return path / FILE_NAME if os.path.isdir(path) else path


def _write_index(place: Path, config: CorpusConfig, shards: Sequence[Shard]) -> None:
    contents = {shard.name: shard.content for shard in shards}
    content = hashlib.sha256("".join(contents.values()).encode()).hexdigest()
    index = {"content": content, "pieces": list(config.pieces), "shards": contents}
    write_json(place / INDEX, index)
