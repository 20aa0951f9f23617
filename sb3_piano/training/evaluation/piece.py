"""Evaluation on one piece: episodes that a player plays, and what is made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from sb3_piano.envs import Recording
from sb3_piano.exceptions import ConfigError
from sb3_piano.metrics import Losses, has_value
from sb3_piano.music import Score
from sb3_piano.music.difficulty import MotionRecording
from sb3_piano.players import TreeSearch
from sb3_piano.training.evaluation.evaluations import Evaluation
from sb3_piano.training.evaluation.statistics import Summary, summarize
from sb3_piano.training.playing.player import OpenPlayer


class Episode(NamedTuple):
    """An episode, without what is not needed any more."""

    seed: int
    metrics: Mapping[str, float]
    score: Score | None
    motion: MotionRecording | None
    losses: Losses | None


def play_piece(
    player: OpenPlayer,
    episodes: int,
    seeds: Sequence[int],
    motion: bool,
    on_episode: Callable[[], object],
) -> tuple[Evaluation, list[Episode]]:
    """Return the evaluation of what a player plays until Ctrl-C, and the episodes.

    Raises:
        ConfigError: If the motion is to be kept, but the environment is no piano.
        KeyboardInterrupt: If no episode was finished before Ctrl-C.
    """
    played, resting = _played(player, episodes, seeds, motion, on_episode)
    whole = len(played) == episodes * len(seeds)
    return _evaluation(player, played, resting, interrupted=not whole), played


def summaries(metrics: Sequence[Mapping[str, float]]) -> dict[str, Summary]:
    """Return the statistics of each metric, over those that say anything: timing needs a hit."""
    return {
        name: summarize(
            [each[name] for each in metrics if has_value(name, each)]
            or [each[name] for each in metrics]
        )
        for name in metrics[0]
    }


def _played(
    player: OpenPlayer,
    episodes: int,
    seeds: Sequence[int],
    motion: bool,
    on_episode: Callable[[], object],
) -> tuple[list[Episode], Recording | None]:
    """Return what a player plays until Ctrl-C, one episode at least, and one of resting hands."""
    played: list[Episode] = []
    resting = player.rest()  # first, so that Ctrl-C cannot leave episodes without it
    if motion and resting is None:
        raise ConfigError(f"{player.named} is of no piano: expected no motion=True.")
    try:
        for one in seeds:
            for recording in player.episodes(episodes, seed=one):
                moved = _motion(recording) if motion else None
                performance = recording.performance
                score_played = None if performance is None else performance.to_score()
                lost = None if performance is None else performance.losses()
                played.append(Episode(one, recording.metrics, score_played, moved, lost))
                on_episode()
    except KeyboardInterrupt:
        if not played:
            raise
    return played, resting


def _evaluation(
    player: OpenPlayer,
    played: Sequence[Episode],
    resting: Recording | None,
    *,
    interrupted: bool,
) -> Evaluation:
    """Return the evaluation of episodes of one piece."""
    tree = player.spec.tree
    metrics = [episode.metrics for episode in played]
    losses = [episode.losses for episode in played if episode.losses is not None]
    return Evaluation(
        run=Path(str(player.spec)) if player.run is None else player.run.path,
        algo=player.algo if tree is None else f"{player.algo}, tree {tree}",
        piece=player.piece,
        num_timesteps=player.num_timesteps,
        training_seed=player.training_seed,
        env_kwargs=player.env_spec.options,
        episodes=tuple(metrics),
        episode_seeds=tuple(episode.seed for episode in played),
        summary=summaries(metrics),
        baseline=None if resting is None else resting.metrics,
        losses=Losses.sum_of(losses) if losses else None,
        interrupted=interrupted,
        tree=player.model.statistics if isinstance(player.model, TreeSearch) else None,
    )


def _motion(recording: Recording) -> MotionRecording | None:
    """Return how everything moved, under the title of what was played."""
    played, motion = recording.performance, recording.motion
    if played is None or motion is None:
        return None
    return MotionRecording(title=played.title, **vars(motion))
