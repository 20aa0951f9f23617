"""Evaluation: what a trained model plays, beside playing nothing."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError
from sb3_piano.files import write_json
from sb3_piano.music import Score
from sb3_piano.music.difficulty import MotionRecording
from sb3_piano.training.performance_files import (
    clear_performances,
    motion_recording,
    write_motions,
    write_performances,
)
from sb3_piano.training.playing import SavedPlayer
from sb3_piano.training.run_folder import RunFolder
from sb3_piano.training.statistics import Summary, summarize

Seeds = int | Sequence[int]


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """What :func:`evaluate` found.

    The names of metrics are ``return``, ``length`` (steps) and, for piano environments, those of
    ``sb3_piano.metrics.EPISODE_METRICS`` and ``sb3_piano.envs.RETURN_KEYS``.
    """

    run: Path
    """The run's folder."""
    algo: str
    """Name of the algorithm."""
    piece: str
    """What was played; the environment's id if it is no piano."""
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
    """Mean, standard deviation and interval of each metric over all episodes."""
    baseline: Mapping[str, float] | None
    """Metrics of an episode in which the hands rest; ``None`` if the environment is no piano."""
    performances: tuple[Path | None, ...] = ()
    """The MIDI file of each episode, ``None`` if no key was pressed in it; empty if none was
    written, as for any piece but the run's own."""
    motions: tuple[Path, ...] = ()
    """The file of how everything moved in each episode; empty if none was asked for."""
    metrics_file: Path | None = None
    """The file in the run's folder with all this; ``None`` if none was written."""
    interrupted: bool = False
    """Whether Ctrl-C ended it before all episodes were played."""

    @property
    def mean(self) -> dict[str, float]:
        """Mean of each metric over the episodes."""
        return {name: summary.mean for name, summary in self.summary.items()}

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each metric over the episodes (of the population; 0 for one)."""
        return {name: summary.std for name, summary in self.summary.items()}

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
        ``None``; ``no_interval`` then has the reason.
        """
        summaries = self.summary.items()
        return {
            "run": str(self.run),
            "algo": self.algo,
            "piece": self.piece,
            "num_timesteps": self.num_timesteps,
            "training_seed": self.training_seed,
            "env_kwargs": dict(self.env_kwargs),
            "interrupted": self.interrupted,
            "mean": self.mean,
            "std": self.std,
            "interval": {name: _listed(summary.interval) for name, summary in summaries},
            "no_interval": {name: s.no_interval for name, s in summaries if s.no_interval},
            "baseline": None if self.baseline is None else dict(self.baseline),
            "episodes": [dict(metrics) for metrics in self.episodes],
            "episode_seeds": list(self.episode_seeds),
            "performances": [None if path is None else path.name for path in self.performances],
            "motions": [path.name for path in self.motions],
        }


@dataclass(frozen=True, kw_only=True)
class _Played:
    """An episode, without what is not needed any more."""

    seed: int
    metrics: Mapping[str, float]
    score: Score | None
    motion: MotionRecording | None


def evaluate(
    folder: str | os.PathLike[str],
    episodes: int = 1,
    seed: Seeds = 0,
    *,
    physics: str | None = None,
    score: Score | str | os.PathLike[str] | None = None,
    best: str | None = None,
    motion: bool = False,
    on_episode: Callable[[], object] = lambda: None,
) -> Evaluation:
    """Let a run's saved model play, without exploring, and say how well it did.

    The environment has the run's wrappers and normalisation; returns and metrics are those of the
    bare environment inside. Unless another piece is given, writes ``evaluation/metrics.json`` and,
    from 1 on, ``evaluation/performance_<i>.mid`` into the run's folder, in place of those that
    were there; ``motion`` adds a file beside each.

    Ctrl-C ends it with the episodes that are finished, see ``interrupted`` of the result; before
    the first one it is a ``KeyboardInterrupt`` as everywhere.

    Args:
        folder: The run's folder.
        episodes: How many episodes to play from each seed, at least 1.
        seed: Seeds the environment, at least 0; of several, each is used once. The resting hands
            get the first one.
        physics: Name of the physics profile to play on; by default the run's own.
        score: What to play in place of the run's own piece.
        best: Play the best model by this metric, such as "f1", in place of the last one.
        motion: Also write ``evaluation/performance_<i>.npz``, how everything moved (see
            :mod:`sb3_piano.music.difficulty.recording`).
        on_episode: Is called after each episode.

    Raises:
        ConfigError: If ``episodes`` or ``seed`` is out of range, the run's config is damaged, or
            the motion is to be written for another piece or of no piano.
        RunError: If there is no run, it has no model that can be loaded, or what it observes
            cannot show the score.
        ScoreError: If the score cannot be read.
    """
    seeds = checked_seeds(seed)
    if episodes < 1:
        raise ConfigError(f"episodes is {episodes}: expected 1 or more.")
    if motion and score is not None:
        raise ConfigError("Of another piece no motion is written: expected the run's own one.")
    played: list[_Played] = []
    with SavedPlayer.open(folder, seed=seeds[0], physics=physics, score=score, best=best) as player:
        resting = player.rest()  # first, so that Ctrl-C cannot leave episodes without it
        if motion and resting is None:
            raise ConfigError(f"Run '{player.run.path}' is of no piano: expected no motion=True.")
        try:
            for episode in _play(player, episodes, seeds, motion):
                played.append(episode)
                on_episode()
        except KeyboardInterrupt:
            if not played:
                raise
    found = Evaluation(
        run=player.run.path,
        algo=player.config.algo,
        piece=player.piece,
        num_timesteps=player.num_timesteps,
        training_seed=player.run.read_config().seed,  # that of the player is its own
        env_kwargs=player.config.env_kwargs,
        episodes=tuple(episode.metrics for episode in played),
        episode_seeds=tuple(episode.seed for episode in played),
        summary=_summaries([episode.metrics for episode in played]),
        baseline=None if resting is None else resting.metrics,
        interrupted=len(played) < episodes * len(seeds),
    )
    return found if score is not None else _written(found, player.run, played)


def checked_seeds(seeds: Seeds) -> tuple[int, ...]:
    """Return seeds as a tuple.

    Raises:
        ConfigError: If there is none, one is below 0, or one is there twice.
    """
    several = (seeds,) if isinstance(seeds, int) else tuple(seeds)
    if not several:
        raise ConfigError("There are no seeds: expected at least one.")
    for seed in several:
        if seed < 0:
            raise ConfigError(f"seed is {seed}: expected 0 or more.")
        if several.count(seed) > 1:
            raise ConfigError(
                f"seed {seed} is given {several.count(seed)} times: expected each seed once, as "
                "its episodes would only be counted again."
            )
    return several


def _play(
    player: SavedPlayer, episodes: int, seeds: Sequence[int], motion: bool
) -> Iterator[_Played]:
    for seed in seeds:
        recordings = player.episodes(seed=seed)
        for _ in range(episodes):
            recording = next(recordings)
            played = recording.performance
            score = None if played is None else played.to_score()
            yield _Played(
                seed=seed,
                metrics=recording.metrics,
                score=score,
                motion=motion_recording(recording, player.piece) if motion else None,
            )


def _summaries(episodes: Sequence[Mapping[str, float]]) -> dict[str, Summary]:
    return {name: summarize([metrics[name] for metrics in episodes]) for name in episodes[0]}


def _listed(interval: tuple[float, float] | None) -> list[float] | None:
    return None if interval is None else list(interval)


def _written(found: Evaluation, run: RunFolder, played: Sequence[_Played]) -> Evaluation:
    clear_performances(run)
    metrics_file = run.evaluation_dir / "metrics.json"
    evaluation = dataclasses.replace(
        found,
        performances=write_performances(run, [episode.score for episode in played]),
        motions=write_motions(run, [e.motion for e in played if e.motion is not None]),
        metrics_file=metrics_file,
    )
    write_json(metrics_file, evaluation.to_json())
    return evaluation
