"""Evaluation of a player on one piece."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from sb3_piano.exceptions import ConfigError
from sb3_piano.metrics import Losses
from sb3_piano.metrics.episode import has_value
from sb3_piano.players import TreeSearch
from sb3_piano.take import Take
from sb3_piano.training.evaluation.evaluations import Evaluation
from sb3_piano.training.evaluation.statistics import Summary, summarize
from sb3_piano.training.playing.player import OpenPlayer


def play_piece(
    player: OpenPlayer,
    episodes: int,
    seeds: Sequence[int],
    motion: bool,
    musical: bool,
    on_episode: Callable[[], object],
) -> tuple[Evaluation, list[Take]]:
    """Play episodes until done or Ctrl-C; return their evaluation and the episodes.

    Raises:
        ConfigError: If ``motion`` or ``musical`` is true, but the environment is no piano.
        KeyboardInterrupt: If no episode was finished before Ctrl-C.
    """
    played, resting = _played(player, episodes, seeds, motion, musical, on_episode)
    whole = len(played) == episodes * len(seeds)
    return _evaluation(player, played, resting, interrupted=not whole), played


def summaries(metrics: Sequence[Mapping[str, float]]) -> dict[str, Summary]:
    """Return the statistics of each metric over its values: timing has none without a hit."""
    return {
        name: summarize(
            [each[name] for each in metrics if has_value(name, each)]
            or [each[name] for each in metrics if name in each]
        )
        for name in dict.fromkeys(name for each in metrics for name in each)
    }


def _played(
    player: OpenPlayer,
    episodes: int,
    seeds: Sequence[int],
    motion: bool,
    musical: bool,
    on_episode: Callable[[], object],
) -> tuple[list[Take], Take | None]:
    """Play until done or Ctrl-C; return at least one episode, and one of resting hands."""
    played: list[Take] = []
    resting = player.rest()  # first, so that Ctrl-C cannot leave episodes without it
    for name, wanted in (("motion", motion), ("musical", musical)):
        if wanted and resting is None:
            raise ConfigError(f"{player.named} is of no piano: expected no {name}=True.")
    try:
        for one in seeds:
            for take in player.episodes(episodes, seed=one):
                if musical:
                    defined = {n: v for n, v in take.musicianship().items() if not math.isnan(v)}
                    take = dataclasses.replace(take, metrics={**take.metrics, **defined})
                played.append(take if motion else dataclasses.replace(take, motion=None))
                on_episode()
    except KeyboardInterrupt:
        if not played:
            raise
    return played, resting


def _evaluation(
    player: OpenPlayer,
    played: Sequence[Take],
    resting: Take | None,
    *,
    interrupted: bool,
) -> Evaluation:
    tree = player.spec.tree
    metrics = [take.metrics for take in played]
    losses = [take.performance.losses() for take in played if take.performance is not None]
    return Evaluation(
        run=Path(str(player.spec)) if player.run is None else player.run.path,
        algo=player.algo if tree is None else f"{player.algo}, tree {tree}",
        piece=player.piece,
        num_timesteps=player.num_timesteps,
        training_seed=player.training_seed,
        env_kwargs=player.env_spec.options,
        episodes=tuple(metrics),
        episode_seeds=tuple(take.seed or 0 for take in played),
        summary=summaries(metrics),
        baseline=None if resting is None else resting.metrics,
        losses=Losses.sum_of(losses) if losses else None,
        interrupted=interrupted,
        tree=player.model.statistics if isinstance(player.model, TreeSearch) else None,
    )
