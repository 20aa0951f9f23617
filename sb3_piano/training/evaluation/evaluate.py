"""Evaluation of trained models and other players, with resting hands as the baseline."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import logging
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from sb3_piano.envs.score_choice import own_score
from sb3_piano.exceptions import ConfigError, SB3PianoError
from sb3_piano.files import write_json
from sb3_piano.jobs.folders import unwritable
from sb3_piano.links import make_folder
from sb3_piano.metrics import Losses
from sb3_piano.music import Score, load_score, write_midi
from sb3_piano.music.catalogue import is_path
from sb3_piano.players import PLAYERS, PlayerSpec
from sb3_piano.settings import Count, Index, checked
from sb3_piano.take import SUFFIX, Take
from sb3_piano.training.configuration.env_spec import EnvSpec
from sb3_piano.training.evaluation.evaluations import Evaluation, Evaluations, Failure
from sb3_piano.training.evaluation.piece import play_piece, summaries
from sb3_piano.training.playing.player import OpenPlayer
from sb3_piano.training.runs.folder import RunFolder

_log = logging.getLogger(__name__)

Seeds = int | Sequence[int]

_Player = PlayerSpec | str | os.PathLike[str]


def evaluate(
    player: _Player,
    episodes: int = 1,
    seed: Seeds = 0,
    *,
    env: EnvSpec | None = None,
    physics: str | None = None,
    score: Score | str | os.PathLike[str] | None = None,
    best: str | None = None,
    motion: bool = False,
    musical: bool = False,
    on_episode: Callable[[], object] = lambda: None,
) -> Evaluation:
    """Evaluate a saved run with its deterministic policy, or another player.

    The environment has the run's wrappers and normalisation; returns and metrics are those of the
    bare environment inside. A run with several ``pieces`` plays each of them. Without another piece
    and without a tree, it writes ``evaluation/metrics.json`` and ``evaluation/performance_<i>.mid``
    (counted from 1) into the run's folder and replaces former ones; ``motion`` adds a file beside
    each.

    Ctrl-C returns the finished episodes, see ``interrupted`` of the result; before the first
    finished episode it raises ``KeyboardInterrupt``.

    Args:
        player: The run's folder, or the spec of another player such as "tree:64x8:runs/td3/x" or
            "sight-reader", which needs a ``score``.
        episodes: Number of episodes per piece and seed, at least 1.
        seed: Seed, or distinct seeds, of the environment, at least 0. The resting hands use the
            first one.
        env: Environment of a player without a run, as in
            :meth:`~sb3_piano.training.OpenPlayer.open`.
        physics: Name of the physics profile; by default the run's own.
        score: Piece to play instead of the run's own.
        best: Use the best model by this metric, such as "f1", instead of the last.
        motion: Also write ``evaluation/performance_<i>.npz``, the whole take.
        musical: Also compute the numbers of :meth:`Take.musicianship
            <sb3_piano.take.Take.musicianship>`; undefined ones are left out.
        on_episode: Called after each episode.

    Raises:
        ConfigError: If ``episodes`` or ``seed`` is out of range, the run's config is damaged, or
            ``motion`` is true for another piece or without a piano, or ``musical`` without one.
        RunError: If there is no run, its model cannot be loaded, its observation cannot show the
            score, or its folder cannot be written.
        ScoreError: If the score cannot be read.
    """
    evaluation, _ = _evaluated(
        player,
        _checked(seed, episodes),
        score,
        keep_going=False,
        env=env,
        physics=physics,
        best=best,
        episodes=episodes,
        motion=motion,
        musical=musical,
        on_episode=on_episode,
    )
    return evaluation


def evaluate_runs(
    players: Sequence[_Player],
    episodes: int = 1,
    seeds: Seeds = 0,
    *,
    env: EnvSpec | None = None,
    physics: str | None = None,
    scores: Sequence[Score | str | os.PathLike[str]] = (),
    best: str | None = None,
    motion: bool = False,
    musical: bool = False,
    on_episode: Callable[[], object] = lambda: None,
) -> Evaluations:
    """Evaluate several runs or players, each on its own pieces or on the given ones.

    A failing piece or run does not stop the others. Ctrl-C does, and returns the results so far.
    Arguments, files in the runs' folders and errors are as for
    :func:`~sb3_piano.training.evaluate`. A run may be given only once. ``motion`` is written only
    for the runs' own pieces. A run with a failed piece gets no files.
    """
    seeds = _checked(seeds, episodes)
    texts = list(map(str, players))
    names = [t if t.partition(":")[0] in (*PLAYERS, "tree") else os.path.realpath(t) for t in texts]
    for player, name in zip(players, names, strict=True):
        if names.count(name) > 1:
            raise ConfigError(f"Run '{player}' is given twice: expected each run once.")
    given: Sequence[Score | None] = _distinct(scores) or [None]
    found: list[Evaluation] = []
    failures: list[Failure] = []
    interrupted = False
    for run, piece in itertools.product(players, given):
        errors: list[_Error] = []
        try:
            evaluation, errors = _evaluated(
                run,
                seeds,
                piece,
                keep_going=True,
                env=env,
                physics=physics,
                best=best,
                episodes=episodes,
                motion=motion,
                musical=musical,
                on_episode=on_episode,
            )
            found += evaluation.by_piece or [evaluation]
            interrupted = evaluation.interrupted
        except KeyboardInterrupt:
            interrupted = True
        except Exception as error:  # wrappers of a run may fail in any way
            errors = [(None if piece is None else piece.title, error)]
        failures += [_failure(run, *error) for error in errors]
        if interrupted:
            break
    return Evaluations(evaluations=tuple(found), failures=tuple(failures), interrupted=interrupted)


def _distinct(scores: Sequence[Score | str | os.PathLike[str]]) -> list[Score]:
    """Load scores; those from files of equal names get their paths as titles."""
    found = [load_score(score) for score in scores]
    titles = [score.title for score in found]
    return [
        score
        if isinstance(source, Score) or titles.count(score.title) == scores.count(source)
        else dataclasses.replace(score, title=os.fspath(source))
        for source, score in zip(scores, found, strict=True)
    ]


def pieces_of(run: RunFolder) -> Sequence[str | None]:
    """Return the pieces of a run with several; ``[None]`` for a run with one.

    Raises:
        ConfigError: If its settings are damaged.
    """
    config = run.read_config()
    return config.pieces if len(config.pieces) > 1 else [None]


def _as_trained(run: RunFolder, piece: str | None, pieces: Sequence[str | None]) -> Score | None:
    """Load one of a run's pieces as in its environment; ``None`` for its only piece.

    Files of equal names get their paths as titles.
    """
    if piece is None:
        return None
    score, _ = own_score(piece, run.read_config().env_kwargs)
    stems = [Path(other).stem for other in pieces if other is not None and is_path(other)]
    if is_path(piece) and stems.count(Path(piece).stem) > 1:
        score = dataclasses.replace(score, title=piece)
    return score


_Error = tuple[str | None, Exception]
"""A failed piece, ``None`` for the run's only piece, and the error."""

_Played = tuple[Evaluation, list[Take]]

_Task = tuple[str | None, Callable[[], Score | str | os.PathLike[str] | None]]
"""The name of a piece, if any, and a function that returns the score to play."""


def _failure(run: _Player, piece: str | None, error: Exception) -> Failure:
    known = isinstance(error, SB3PianoError)
    if not known:
        _log.error("Evaluating run '%s' failed.", run, exc_info=error)
    return Failure(run=Path(str(run)), piece=piece, reason=str(error) if known else repr(error))


def _evaluated(
    who: _Player,
    seeds: Sequence[int],
    score: Score | str | os.PathLike[str] | None,
    *,
    keep_going: bool,
    env: EnvSpec | None,
    physics: str | None,
    best: str | None,
    episodes: int,
    motion: bool,
    musical: bool,
    on_episode: Callable[[], object],
) -> tuple[Evaluation, list[_Error]]:
    """Evaluate a run on all its pieces, or on a given one; also return the errors.

    ``keep_going`` continues after errors; if all pieces fail, the first error is raised. Other
    arguments are as for :func:`evaluate`.
    """
    player = who if isinstance(who, PlayerSpec) else PlayerSpec.parse(who)
    tree = player.tree
    alone = score is None and tree is None and player.is_run
    if motion and not alone:
        raise ConfigError(
            f"Of {'another piece' if tree is None else 'a tree search'} no motion is written: "
            "expected the run's own piece, without a tree."
        )
    run = RunFolder.open(player.name) if player.is_run else None
    tasks: list[_Task] = [(None, lambda: score)]
    if isinstance(score, str):
        tasks = [(score, lambda: score)]
    elif score is None and run is not None and run.read_player() is None:
        own = pieces_of(run)
        tasks = [(piece, partial(_as_trained, run, piece, own)) for piece in own]
    options: dict[str, Any] = {"seed": seeds[0], "physics": physics, "best": best}
    errors: list[_Error] = []

    def play(task: _Task) -> _Played | None:
        name, source = task
        try:
            with OpenPlayer.open(player, env, score=source(), **options) as opened:
                if alone and run is not None:
                    _try_out(run.evaluation_dir)  # before the work of playing
                return play_piece(opened, episodes, seeds, motion, musical, on_episode)
        except Exception as error:
            if not keep_going:
                raise
            errors.append((name, error))
            return None

    played, interrupted = _until_ctrl_c(map(play, tasks))
    if not played:
        raise errors[0][1]
    if run is None or not alone or errors:
        return _combined([found for found, _ in played], len(tasks), interrupted), errors
    with _writing_in(run.evaluation_dir):
        file = run.evaluation_dir / "metrics.json"
        whole = _combined(_with_files(played, file), len(tasks), interrupted)
        write_json(file, whole.to_json())
    return whole, errors


def _until_ctrl_c(results: Iterator[_Played | None]) -> tuple[list[_Played], bool]:
    """Collect results until Ctrl-C; also return whether Ctrl-C ended them.

    Raises:
        KeyboardInterrupt: If there is no result before Ctrl-C.
    """
    played: list[_Played] = []
    try:
        for result in results:
            if result is None:
                continue
            played.append(result)
            if result[0].interrupted:
                return played, True
    except KeyboardInterrupt:
        if not played:
            raise
        return played, True
    return played, False


def _checked(seeds: Seeds, episodes: int) -> tuple[int, ...]:
    """Return the seeds as a tuple; raise ConfigError for invalid seeds or ``episodes``."""
    several = (seeds,) if isinstance(seeds, int) else tuple(seeds)
    if not several:
        raise ConfigError("There are no seeds: expected at least one.")
    for seed in several:
        checked("seed", seed, Index)
        if several.count(seed) > 1:
            raise ConfigError(
                f"seed {seed} is given {several.count(seed)} times: expected each seed once, as "
                "its episodes would be counted twice."
            )
    checked("episodes", episodes, Count)
    return several


def _combined(found: Sequence[Evaluation], n_pieces: int, interrupted: bool) -> Evaluation:
    """Combine a run's evaluations of single pieces."""
    if n_pieces == 1:
        return dataclasses.replace(found[0], interrupted=interrupted)
    losses = [one.losses for one in found if one.losses is not None]
    resting = [one.baseline for one in found if one.baseline is not None]
    return dataclasses.replace(
        found[0],
        piece=f"{n_pieces} pieces",
        episodes=tuple(episode for one in found for episode in one.episodes),
        episode_seeds=tuple(seed for one in found for seed in one.episode_seeds),
        summary=summaries([one.mean for one in found]),
        baseline={name: each.mean for name, each in summaries(resting).items()},
        performances=tuple(file for one in found for file in one.performances),
        losses=Losses.sum_of(losses),
        tree=None,
        motions=tuple(file for one in found for file in one.motions),
        interrupted=interrupted,
        by_piece=tuple(found),
    )


@contextlib.contextmanager
def _writing_in(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise unwritable(folder, error) from error


def _try_out(folder: Path) -> None:
    """Raise RunError for a folder in which no file can be created."""
    with _writing_in(folder):
        make_folder(folder)
        tempfile.TemporaryFile(dir=folder).close()


def _with_files(played: Sequence[_Played], metrics_file: Path) -> list[Evaluation]:
    """Write the performances beside the file of metrics, and delete former ones."""
    folder = metrics_file.parent
    for stale in (*folder.glob("performance_*.mid"), *folder.glob("performance_*.npz")):
        stale.unlink()
    evaluations = []
    numbers = itertools.count(1)
    for found, episodes in played:
        scores, motions = [], []
        for take, number in zip(episodes, numbers, strict=False):
            file = folder / f"performance_{number}.mid"
            scores.append(None if take.score is None else file)
            if take.score is not None:
                write_midi(take.score, file, by_finger=False)
            if take.motion is not None:
                motions.append(file.with_suffix(SUFFIX))
                take.write(motions[-1])
        evaluations.append(
            dataclasses.replace(
                found,
                performances=tuple(scores),
                motions=tuple(motions),
                metrics_file=metrics_file,
            )
        )
    return evaluations
