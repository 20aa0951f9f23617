"""Record corpora: many pieces, performed by several players with noise, shard by shard."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import os
import shlex
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
from annotated_types import Ge, MinLen
from pydantic import BeforeValidator

from sb3_piano.demonstrations import shards as datasets
from sb3_piano.demonstrations.corpus import CONFIG, DATA, INDEX, RecordedCorpus
from sb3_piano.demonstrations.dataset import forget_unfinished, require_minari
from sb3_piano.demonstrations.disturbances import DEFAULT_MEMORY, ActuatorNoise
from sb3_piano.demonstrations.recording import play_episode
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, PlanWarning, RunError
from sb3_piano.files import write_json
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs.folders import begin_or_resume, shared_folder
from sb3_piano.links import make_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.music import Score, load_score, select_pieces
from sb3_piano.music.library import Library
from sb3_piano.music.score import digest
from sb3_piano.players import Player, PlayerSpec
from sb3_piano.settings import Count, Index, Listed, NotNegative, Number, Positive, Unit, settings
from sb3_piano.threads import torch_computing
from sb3_piano.training.configuration.plugins import Plugin
from sb3_piano.training.configuration.values import plain
from sb3_piano.training.playing.player import stage_for
from sb3_piano.training.playing.player_files import player_files
from sb3_piano.training.playing.recording import player_to_record
from sb3_piano.training.runs.provenance import provenance

Env = gym.Env[Any, Any]
_Noise = Annotated[tuple[Annotated[Number, Ge(0), Unit("rad")], ...], MinLen(1), Listed]


def _pieces(value: Any) -> tuple[str, ...]:
    found = select_pieces(value)
    if any(isinstance(piece, Score) for piece in found):
        raise ConfigError("pieces has a score: expected a name or file, found by other processes.")
    return tuple(map(str, found))


@settings
class CorpusConfig:
    """All settings of a corpus of performances.

    Each player performs each excerpt ``episodes`` times, with the noise levels in turn.
    Performances are numbered in this order. Each one depends only on the settings and its number.
    """

    pieces: Annotated[tuple[str, ...], BeforeValidator(_pieces)]
    """Entries of :func:`~sb3_piano.music.select_pieces`."""
    players: Annotated[tuple[str, ...], MinLen(1), Listed] = ("planned",)
    """Specs of players, see :class:`~sb3_piano.players.PlayerSpec`."""
    excerpts: Count | None = None
    """Number of excerpts, drawn from the pieces in turn; by default one of each piece."""
    seconds: Positive | None = None
    """Length of an excerpt, s, from a randomly drawn note on; by default whole pieces."""
    episodes: Count = 4
    """Performances of each excerpt by each player."""
    noise: _Noise = (0.0, 0.03, 0.06, 0.1)  # chosen so that recoveries are recorded
    """Standard deviations of the noise on the actions, rad; an excerpt's performances take
    turns."""
    noise_memory: Annotated[NotNegative, Unit("s")] = DEFAULT_MEMORY
    """Time constant of the noise's autocorrelation (decay to 1/e), s."""
    start: Annotated[NotNegative, Unit("rad")] = 0.0
    """Standard deviation of the joints at the start, rad."""
    by_hand: bool = False
    """Whether to record by hand (observation "hands" and :class:`~sb3_piano.wrappers.HandActions`),
    as ``distill`` needs."""
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    """Options of the environment, except the score; runs use their own."""
    shard: Count = 25
    """Performances in one data set, which one process records."""
    seed: Index = 0
    """Seed of the excerpts, the noise and the starts."""

    def __post_init__(self) -> None:
        for player in self.players:
            PlayerSpec.parse(player)

    def __len__(self) -> int:
        """Return the number of performances."""
        n_excerpts = len(self.pieces) if self.excerpts is None else self.excerpts
        return n_excerpts * len(self.players) * self.episodes

    def performance(self, number: int) -> tuple[Score, dict[str, Any]]:
        """Compute what a numbered performance plays, and its facts.

        These are its ``piece`` (name or file) and title, ``player`` (a spec), ``noise`` (standard
        deviation, rad), and the ``seed`` of the environment, the player and the noise.
        """
        rest, turn = divmod(number, self.episodes)
        excerpt, player = divmod(rest, len(self.players))
        piece = self.pieces[excerpt % len(self.pieces)]
        score = load_score(piece)
        if self.seconds is not None:
            random = np.random.default_rng((self.seed, excerpt, 0))
            last = max(score.duration - self.seconds, score.notes[0].onset)
            start = float(random.choice(sorted({n.onset for n in score.notes if n.onset <= last})))
            part = score.excerpt(start, start + self.seconds)
            score = dataclasses.replace(part, title=f"{score.title} from {start:.2f} s")
        seed = float(np.random.SeedSequence((self.seed, number)).generate_state(1)[0])
        facts = {"performance": float(number), "seed": seed, "piece": piece, "title": score.title}
        noise = self.noise[turn % len(self.noise)]
        return score, {**facts, "player": self.players[player], "noise": noise}


def record_corpus(
    config: CorpusConfig,
    folder: str | os.PathLike[str],
    *,
    on_progress: Callable[[int, int], object] = lambda done, total: None,
    executor: Executor | None = None,
    **where: Any,
) -> RecordedCorpus | None:
    """Record a corpus, or resume its recording; return ``None`` if it was interrupted.

    In a folder with a part of the corpus, complete shards are kept; missing or damaged ones are
    made. The result does not depend on who makes it or in which order, given the same kind of
    processor and the same versions of packages.

    ============== ================================================================================
    ``corpus.yml`` settings, and checksums of the files of pieces and players
    ``run.yml``    command line, versions of packages, time
    ``data/``      Minari data sets, and a manifest of each
    ``index.json`` when complete: names and contents of the shards, and a checksum of those
    ============== ================================================================================

    Args:
        config: Settings of the corpus.
        folder: Output folder: new, empty, or with a part of the same corpus.
        on_progress: Called with the number of finished performances and the number of all.
        executor: Executor that sees folder and files by the same paths; by default one is opened
            with ``where``.
        **where: Options of :func:`~sb3_piano.jobs.open_executor`.

    Raises:
        ConfigError: If a setting is not valid, or a player cannot play.
        RunError: If the folder cannot be used, or has other settings.
        MissingPackageError: If Minari is not installed.
    """
    require_minari()
    place = shared_folder(folder)
    _check_players(config)
    busy = f"'{place}' is being worked in"
    with hold(place / LOCK_SUFFIX, busy, "one recording in a folder."), stop_on_signal():
        inputs = _inputs(config)
        settings = {**plain(dataclasses.asdict(config), "corpus"), "files": inputs}
        begin_or_resume(place / CONFIG, "corpus", settings, notes=provenance(config.seed))
        make_folder(place / DATA)
        forget_unfinished(place / DATA)

        def tell(done: int, total: int) -> None:
            on_progress(min(done * config.shard, len(config)), len(config))

        again = f"give the same command again, for {shlex.quote(str(place))}"
        jobs = corpus_jobs(config, place, inputs)
        try:
            made = datasets.make_missing(executor, jobs, tell, go_on=again, **where)
        except KeyboardInterrupt:
            return None
        if not any(shard.steps for shard in made):
            raise RunError(f"Nothing could be played: {next(iter(made[0].skipped.values()))}")
        shards = {shard.name: shard.content for shard in made}
        content = hashlib.sha256("".join(shards.values()).encode()).hexdigest()
        index = {"content": content, "pieces": list(config.pieces), "shards": shards}
        write_json(place / INDEX, index)
    return RecordedCorpus.open(place)


def corpus_jobs(
    config: CorpusConfig, place: Path, inputs: Mapping[str, str] | None = None
) -> list[datasets.ShardJob]:
    """List the jobs of a corpus; ``inputs`` are checksums of the files that determine it."""
    inputs = _inputs(config) if inputs is None else inputs
    settings, size = plain(dataclasses.asdict(config), "corpus"), config.shard
    about = {name: value for name, value in settings.items() if name != "pieces"}
    jobs = []
    for number in range(-(-len(config) // size)):
        name, numbers = f"shard{number:06d}-v0", range(len(config))[number * size :][:size]
        metadata = {
            "algorithm_name": " ".join(config.players),
            "description": f"Performances {numbers} of a corpus.",
            "sb3_piano": about,
        }
        content, playing = [settings, dict(inputs), name], functools.partial(_playing, config)
        jobs.append(datasets.shard_job(name, place / DATA, content, numbers, metadata, playing))
    return jobs


@contextlib.contextmanager
def _playing(config: CorpusConfig) -> Iterator[tuple[Env, datasets.Play]]:
    """Open the environment that is recorded, and a function that records a performance."""
    with torch_computing(1), warnings.catch_warnings(), contextlib.ExitStack() as opened:
        warnings.simplefilter("ignore", PlanWarning)  # the scores show the failures
        players = {n: opened.enter_context(open_player(config, n)) for n in config.players}

        def play(number: int) -> Any:
            score, facts = config.performance(number)
            (player, env), std = players[facts["player"]], facts["noise"]
            noise = ActuatorNoise(env, std, config.noise_memory) if std else None
            episode, notes = play_episode(player, env, int(facts["seed"]), noise, {"score": score})
            return episode, {**facts, **notes}

        yield players[config.players[0]][1], play


@contextlib.contextmanager
def open_player(config: CorpusConfig, name: str) -> Iterator[tuple[Player, Env]]:
    """Open a player and its environment for the length of a block, if the player can play there."""
    spec = PlayerSpec.parse(name)
    if spec.name == "sampling":  # on one core, as each process has
        spec = dataclasses.replace(spec, arguments={"n_threads": 1, **spec.arguments})
    by_hand = {"observation": "hands", "reduced_action_space": False} if config.by_hand else {}
    options = {"observation": "fingers", "physics": "fast", **config.env_kwargs, **by_hand}
    stage = stage_for(config.pieces[0], **options)
    if config.by_hand:
        acting = Plugin(path="sb3_piano.wrappers.HandActions")
        stage = dataclasses.replace(stage, wrappers=(acting,))
    with player_to_record(spec, stage, start=config.start) as (player, env):
        if spec.is_run:
            _check_piece_can_be_given(env, spec.name)
        yield player, env


def _check_piece_can_be_given(env: Env, run: str) -> None:
    piano = env.unwrapped
    if not isinstance(piano, PianoEnv):
        raise ConfigError(f"The run '{run}' has no piano environment: a corpus needs one.")
    other = piano.default_score.stretch(1.5)
    env.reset(seed=0, options={"score": other})
    if not np.isclose(piano.score.duration, other.duration):
        raise ConfigError(
            f"The run '{run}' has wrappers that choose its pieces: expected one without, for "
            "a corpus."
        )


def _check_players(config: CorpusConfig) -> None:
    """Open each player once, so that errors appear now and not in a worker."""
    spaces = None
    for name in config.players:
        with open_player(config, name) as (_, env):
            own = env.observation_space, env.action_space
            if spaces not in (None, own):
                raise ConfigError(
                    f"The player {name!r} observes {own[0]} and plays {own[1]}, "
                    f"unlike {config.players[0]!r}: expected players with equal spaces, or a "
                    "corpus for each."
                )
            spaces = own


def _inputs(config: CorpusConfig) -> dict[str, str]:
    """Compute the checksums of pieces and players' files, by name.

    An imported piece has the checksum of its notes: each account has files of its own.
    """
    library = Library()
    imported = set(library.names())
    notes = {name: digest(library.score(name)) for name in config.pieces if name in imported}
    files = [Path(name) for name in config.pieces if name not in imported]
    files += [file for text in config.players for file in player_files(PlayerSpec.parse(text))]
    return notes | {str(f): datasets.file_digest(f) for f in files if os.path.isfile(f)}
