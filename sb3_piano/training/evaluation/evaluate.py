"""Evaluation: what trained models play, beside playing nothing."""

from __future__ import annotations

import dataclasses
import itertools
import logging
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sb3_piano.envs import Recording
from sb3_piano.exceptions import ConfigError, SB3PianoError
from sb3_piano.files import write_csv, write_json
from sb3_piano.metrics import Losses
from sb3_piano.music import Score, load_score, write_midi
from sb3_piano.music.difficulty import MotionRecording, write_motion
from sb3_piano.players import TreeSearch, TreeSettings
from sb3_piano.players.tree_search import SearchStatistics
from sb3_piano.settings import Count, Index, checked
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.evaluation.statistics import Summary, summarize
from sb3_piano.training.playing.player import SavedPlayer
from sb3_piano.training.runs.folder import RunFolder, unwritable

_log = logging.getLogger(__name__)

Seeds = int | Sequence[int]


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Result of :func:`evaluate`.

    The names of metrics are ``return``, ``length`` (steps) and, for piano environments, those of
    ``sb3_piano.metrics.EPISODE_METRICS`` and ``sb3_piano.envs.RETURN_KEYS``.
    """

    run: Path
    """The run's folder."""
    algo: str
    """Name of the algorithm."""
    piece: str
    """Title of the piece, or how many there are; the environment's id if it is no piano."""
    num_timesteps: int
    """Environment steps that the model was trained for."""
    training_seed: int | None
    """Seed of the training."""
    env_kwargs: Mapping[str, Any]
    """Arguments of the environment that was played in."""
    episodes: tuple[Mapping[str, float], ...]
    """Metrics of each episode."""
    episode_seeds: tuple[int, ...]
    """The seed from which each episode comes; those of one seed stand together, in order."""
    summary: Mapping[str, Summary]
    """Mean, standard deviation and interval of each metric over all episodes; of several pieces,
    over their means."""
    baseline: Mapping[str, float] | None
    """Metrics of an episode in which the hands rest, of several pieces their means; ``None`` if the
    environment is no piano."""
    performances: tuple[Path | None, ...] = ()
    """The MIDI file of each episode, ``None`` if no key was pressed in it; empty if none was
    written, as for any piece but the run's own."""
    losses: Losses | None = None
    """Where frames were lost in all episodes together; ``None`` if the environment is no piano."""
    tree: SearchStatistics | None = None
    """What the trees looked like, if the model looked ahead by a tree search."""
    motions: tuple[Path, ...] = ()
    """The file of how everything moved in each episode; empty if none was asked for."""
    metrics_file: Path | None = None
    """The file in the run's folder with all this; ``None`` if none was written."""
    interrupted: bool = False
    """Whether Ctrl-C ended it before all episodes were played."""
    by_piece: tuple[Evaluation, ...] = ()
    """The evaluation on each piece, of a run that has several; else empty."""

    @property
    def mean(self) -> dict[str, float]:
        """Mean of each metric, as of :attr:`summary`."""
        return {name: summary.mean for name, summary in self.summary.items()}

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each metric, likewise (of the population; 0 for one)."""
        return {name: summary.std for name, summary in self.summary.items()}

    @property
    def has_interval(self) -> bool:
        """Whether any metric varies over the episodes."""
        return any(summary.interval is not None for summary in self.summary.values())

    @property
    def is_repetition(self) -> bool:
        """Whether there are several episodes that are all the same, so that one would have done.

        A policy that does not explore, in an environment that draws nothing at random, plays the
        same from every seed.
        """
        first, *others = self.episodes
        return bool(others) and all(other == first for other in others)

    def to_json(self) -> dict[str, Any]:
        """Return all of it in JSON's types.

        ``mean``, ``std`` and ``interval`` have a value for each metric, the latter both ends or
        ``None``; ``no_interval`` then has the reason. Of several pieces ``evaluations`` has each.
        """

        def own(*names: str) -> dict[str, Any]:
            return {name: getattr(self, name) for name in names}

        summaries = self.summary.items()
        pieces = [evaluation.to_json() for evaluation in self.by_piece]
        return {
            "run": str(self.run),
            **own("algo", "piece", "num_timesteps", "training_seed"),
            "env_kwargs": dict(self.env_kwargs),
            **own("interrupted", "mean", "std"),
            "interval": {name: summary.interval for name, summary in summaries},
            "no_interval": {name: s.no_interval for name, s in summaries if s.no_interval},
            **own("baseline", "episodes", "episode_seeds"),
            "losses": None if self.losses is None else dataclasses.asdict(self.losses),
            "tree": None if self.tree is None else self.tree._asdict(),
            "performances": [None if path is None else path.name for path in self.performances],
            "motions": [path.name for path in self.motions],
            **({"evaluations": pieces} if pieces else {}),
        }


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A run that could not be evaluated."""

    run: Path
    """The run's folder."""
    piece: str | None
    """Piece it should have played; ``None`` for its own."""
    reason: str
    """Message of the error."""

    def __str__(self) -> str:
        on_piece = "" if self.piece is None else f" on {self.piece!r}"
        return f"Run '{self.run}' was not evaluated{on_piece}: {self.reason}"


@dataclass(frozen=True, kw_only=True)
class Evaluations:
    """Result of :func:`evaluate_runs`."""

    evaluations: tuple[Evaluation, ...]
    """One for each run and piece, in the order they were asked for."""
    failures: tuple[Failure, ...] = ()
    """The runs that could not be evaluated."""
    interrupted: bool = False
    """Whether Ctrl-C ended it early."""

    def write_json(self, path: Path) -> None:
        """Write everything, statistics included."""
        failures = [{**vars(failure), "run": str(failure.run)} for failure in self.failures]
        evaluations = [evaluation.to_json() for evaluation in self.evaluations]
        content = {"interrupted": self.interrupted, "evaluations": evaluations}
        write_json(path, {**content, "failures": failures})

    def write_csv(self, path: Path) -> None:
        """Write a row for each episode: run, algorithm, piece, seed, episode, and all metrics.

        Episodes count from 1 on for each seed; a metric that an episode lacks is left empty.
        """
        metrics = dict.fromkeys(name for e in self.evaluations for name in e.summary)
        rows = [
            {
                "run": found.run,
                "algo": found.algo,
                "piece": found.piece,
                "seed": seed,
                "episode": found.episode_seeds[:index].count(seed) + 1,
                **found.episodes[index],
            }
            for found in self.evaluations
            for index, seed in enumerate(found.episode_seeds)
        ]
        write_csv(path, ("run", "algo", "piece", "seed", "episode", *metrics), rows)


def evaluate(
    folder: str | os.PathLike[str],
    episodes: int = 1,
    seed: Seeds = 0,
    *,
    physics: str | None = None,
    score: Score | str | os.PathLike[str] | None = None,
    best: str | None = None,
    tree: TreeSettings | None = None,
    motion: bool = False,
    on_episode: Callable[[], object] = lambda: None,
) -> Evaluation:
    """Let a run's saved model play, without exploring, and say how well it did.

    The environment has the run's wrappers and normalisation; returns and metrics are those of the
    bare environment inside. A run of several ``pieces`` plays each of them. Unless another piece or
    a tree is given, writes ``evaluation/metrics.json`` and, from 1 on,
    ``evaluation/performance_<i>.mid`` into the run's folder, in place of those that were there;
    ``motion`` adds a file beside each.

    Ctrl-C ends it with the episodes that are finished, see ``interrupted`` of the result; before
    the first one it is a ``KeyboardInterrupt`` as everywhere.

    Args:
        folder: The run's folder.
        episodes: How many episodes of a piece to play from each seed, at least 1.
        seed: Seeds the environment, at least 0; of several, each is used once. The resting hands
            get the first one.
        physics: Name of the physics profile to play on; by default the run's own.
        score: What to play in place of the run's own piece.
        best: Play the best model by this metric, such as "f1", in place of the last one.
        tree: Let the model look ahead, see :class:`~sb3_piano.players.TreeSearch`.
        motion: Also write ``evaluation/performance_<i>.npz``, how everything moved (see
            :mod:`sb3_piano.music.difficulty`).
        on_episode: Is called after each episode.

    Raises:
        ConfigError: If ``episodes`` or ``seed`` is out of range, the run's config is damaged, or
            the motion is to be written for another piece or of no piano.
        RunError: If there is no run, it has no model that can be loaded, what it observes cannot
            show the score, or its folder cannot be written.
        ScoreError: If the score cannot be read.
    """
    seeds = _checked(seed, episodes)
    alone = score is None and tree is None
    if motion and not alone:
        raise ConfigError(
            f"Of {'another piece' if tree is None else 'a tree search'} no motion is written: "
            "expected the run's own piece, without a tree."
        )
    run = RunFolder.open(folder)
    pieces = _pieces_of(run) if score is None else [score]
    found: list[Evaluation] = []
    played: list[_Episode] = []
    options: dict[str, Any] = {"seed": seeds[0], "physics": physics, "best": best, "tree": tree}
    for piece in pieces:
        try:
            with SavedPlayer.open(run.path, score=piece, **options) as player:
                if alone:
                    _try_out(run.evaluation_dir)  # before the work of playing
                new, resting = _played(player, episodes, seeds, motion, on_episode)
                whole = len(new) == episodes * len(seeds)
                played += new
                found.append(_evaluation(player, new, resting, tree, interrupted=not whole))
        except KeyboardInterrupt:
            if not found:
                raise
            break
        if found[-1].interrupted:
            break
    evaluation = found[0] if len(pieces) == 1 else _together(found, len(pieces))
    return _written(evaluation, run, played) if alone else evaluation


def evaluate_runs(
    folders: Sequence[str | os.PathLike[str]],
    episodes: int = 1,
    seeds: Seeds = 0,
    *,
    physics: str | None = None,
    scores: Sequence[Score | str | os.PathLike[str]] = (),
    best: str | None = None,
    tree: TreeSettings | None = None,
    motion: bool = False,
    on_episode: Callable[[], object] = lambda: None,
) -> Evaluations:
    """Evaluate several runs, each on its own piece or pieces, or on the given ones.

    What cannot be evaluated does not stop the others. Ctrl-C does, and all that was played until
    then is returned. Arguments, files in the runs' folders and errors are those of
    :func:`~sb3_piano.training.evaluate`; a run may not be given twice, and ``motion`` is written
    only of the runs' own pieces.
    """
    seeds = _checked(seeds, episodes)
    runs = [Path(folder) for folder in folders]
    for run in runs:
        if [other.resolve() for other in runs].count(run.resolve()) > 1:
            raise ConfigError(f"Run '{run}' is given twice: expected each run once.")
    given: list[Score | None] = [load_score(score) for score in scores]
    found: list[Evaluation] = []
    failures: list[Failure] = []
    interrupted = False
    for run, piece in itertools.product(runs, given or [None]):
        try:
            evaluation = evaluate(
                run,
                episodes,
                seeds,
                physics=physics,
                score=piece,
                best=best,
                tree=tree,
                motion=motion,
                on_episode=on_episode,
            )
            found += evaluation.by_piece or [evaluation]
            interrupted = evaluation.interrupted
        except KeyboardInterrupt:
            interrupted = True
        except Exception as error:  # a run's own wrappers may fail in any way
            reason = str(error)
            if not isinstance(error, SB3PianoError):
                _log.exception("Evaluating run '%s' failed.", run)
                reason = repr(error)
            title = None if piece is None else piece.title
            failures.append(Failure(run=run, piece=title, reason=reason))
        if interrupted:
            break
    return Evaluations(evaluations=tuple(found), failures=tuple(failures), interrupted=interrupted)


def _pieces_of(run: RunFolder) -> list[Score | None]:
    """Return the pieces of a run that has several; ``None`` stands for its only one."""
    config = run.read_config()
    several = config.pieces if isinstance(config, RunConfig) else ()
    return [load_score(piece) for piece in several] if len(several) > 1 else [None]


def _checked(seeds: Seeds, episodes: int) -> tuple[int, ...]:
    """Return seeds as a tuple."""
    several = (seeds,) if isinstance(seeds, int) else tuple(seeds)
    if not several:
        raise ConfigError("There are no seeds: expected at least one.")
    for seed in several:
        checked("seed", seed, Index)
        if several.count(seed) > 1:
            raise ConfigError(
                f"seed {seed} is given {several.count(seed)} times: expected each seed once, as "
                "its episodes would only be counted again."
            )
    checked("episodes", episodes, Count)
    return several


class _Episode(NamedTuple):
    """An episode, without what is not needed any more."""

    seed: int
    metrics: Mapping[str, float]
    score: Score | None
    motion: MotionRecording | None
    losses: Losses | None


def _played(
    player: SavedPlayer,
    episodes: int,
    seeds: Sequence[int],
    motion: bool,
    on_episode: Callable[[], object],
) -> tuple[list[_Episode], Recording | None]:
    """Return what a player plays until Ctrl-C, one episode at least, and one of resting hands."""
    played: list[_Episode] = []
    resting = player.rest()  # first, so that Ctrl-C cannot leave episodes without it
    if motion and resting is None:
        raise ConfigError(f"Run '{player.run.path}' is of no piano: expected no motion=True.")
    try:
        for one in seeds:
            for recording in itertools.islice(player.episodes(seed=one), episodes):
                moved = _titled_motion(recording, player.piece) if motion else None
                performance = recording.performance
                score_played = None if performance is None else performance.to_score()
                lost = None if performance is None else performance.losses()
                played.append(_Episode(one, recording.metrics, score_played, moved, lost))
                on_episode()
    except KeyboardInterrupt:
        if not played:
            raise
    return played, resting


def _evaluation(
    player: SavedPlayer,
    played: Sequence[_Episode],
    resting: Recording | None,
    tree: TreeSettings | None,
    *,
    interrupted: bool,
) -> Evaluation:
    """Return the evaluation of episodes of one piece."""
    metrics = [episode.metrics for episode in played]
    losses = [episode.losses for episode in played if episode.losses is not None]
    return Evaluation(
        run=player.run.path,
        algo=player.config.algo if tree is None else f"{player.config.algo}, tree {tree}",
        piece=player.piece,
        num_timesteps=player.num_timesteps,
        training_seed=player.run.read_config().seed,  # that of the player is its own
        env_kwargs=player.config.env_kwargs,
        episodes=tuple(metrics),
        episode_seeds=tuple(episode.seed for episode in played),
        summary=_summaries(metrics),
        baseline=None if resting is None else resting.metrics,
        losses=Losses.sum_of(losses) if losses else None,
        interrupted=interrupted,
        tree=player.model.statistics if isinstance(player.model, TreeSearch) else None,
    )


def _together(found: Sequence[Evaluation], n_pieces: int) -> Evaluation:
    """Return the evaluation of a run on all its pieces, of those on each as far as they came."""
    losses = [one.losses for one in found if one.losses is not None]
    resting = [one.baseline for one in found if one.baseline is not None]
    return dataclasses.replace(
        found[0],
        piece=f"{n_pieces} pieces",
        episodes=tuple(episode for one in found for episode in one.episodes),
        episode_seeds=tuple(seed for one in found for seed in one.episode_seeds),
        summary=_summaries([one.mean for one in found]),
        baseline={name: each.mean for name, each in _summaries(resting).items()},
        losses=Losses.sum_of(losses),
        tree=None,
        interrupted=len(found) < n_pieces or found[-1].interrupted,
        by_piece=tuple(found),
    )


def _summaries(metrics: Sequence[Mapping[str, float]]) -> dict[str, Summary]:
    return {name: summarize([each[name] for each in metrics]) for name in metrics[0]}


def _titled_motion(recording: Recording, piece: str) -> MotionRecording | None:
    """Return how everything moved, under the name of the piece that was played."""
    played, motion = recording.performance, recording.motion
    if played is None or motion is None:
        return None
    # A score file that was copied into the run's folder has lost its title.
    title = played.title if played.title in piece.split(" or ") else piece
    return MotionRecording(title=title, **vars(motion))


def _try_out(folder: Path) -> None:
    """Refuse a folder in which no files can be made."""
    try:
        folder.mkdir(exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise unwritable(folder, error) from error


def _written(found: Evaluation, run: RunFolder, played: Sequence[_Episode]) -> Evaluation:
    """Write the files of an evaluation into the run's folder, in place of former ones."""
    folder = run.evaluation_dir
    metrics_file = folder / "metrics.json"
    scores, motions = [], []
    try:
        for stale in (*folder.glob("performance_*.mid"), *folder.glob("performance_*.npz")):
            stale.unlink()
        for number, episode in enumerate(played, start=1):
            file = folder / f"performance_{number}.mid"
            scores.append(None if episode.score is None else file)
            if episode.score is not None:
                write_midi(episode.score, file)
            if episode.motion is not None:
                motions.append(file.with_suffix(".npz"))
                write_motion(episode.motion, motions[-1])
        evaluation = dataclasses.replace(
            found, performances=tuple(scores), motions=tuple(motions), metrics_file=metrics_file
        )
        write_json(metrics_file, evaluation.to_json())
    except OSError as error:
        raise unwritable(folder, error) from error
    return evaluation
