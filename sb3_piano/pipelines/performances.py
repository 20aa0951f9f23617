"""Players of a corpus, and the shards that they play."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from sb3_piano.demonstrations.disturbances import ActuatorNoise
from sb3_piano.demonstrations.recording import play_episode
from sb3_piano.demonstrations.shards import Notes, Play, ShardJob
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, PlanWarning
from sb3_piano.pipelines.corpus_settings import CorpusConfig
from sb3_piano.players import Player, PlayerSpec
from sb3_piano.threads import torch_computing
from sb3_piano.training.configuration.plugins import Plugin
from sb3_piano.training.playing.player import player_to_record, stage_for

if TYPE_CHECKING:
    from minari.data_collector.episode_buffer import EpisodeBuffer

Env = gym.Env[Any, Any]

_BY_HAND = {"observation": "hands", "reduced_action_space": False}


@dataclass(frozen=True, eq=False)
class CorpusJob(ShardJob):
    """Performances of a corpus that are to become a data set."""

    config: CorpusConfig
    """The settings."""
    inputs: Mapping[str, str]
    """SHA-256 of the files that are played or that play."""
    number: int
    """The shard's number, from 0."""
    root: Path

    @property
    def name(self) -> str:
        """Name of the data set."""
        return f"shard{self.number:06d}-v0"

    @property
    def numbers(self) -> range:
        """Numbers of the performances."""
        size = self.config.shard
        return range(len(self.config))[self.number * size :][:size]

    @cached_property
    def digest(self) -> str:
        """Checksum of the settings, the files that are read, and the data set's name."""
        content = [self.config.to_mapping(), dict(self.inputs), self.name]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def metadata(self) -> dict[str, Any]:
        """Players, noise and seed."""
        config = self.config
        return {
            "algorithm_name": " ".join(config.players),
            "description": f"Performances {self.numbers} of a corpus.",
            "sb3_piano": {
                name: value for name, value in config.to_mapping().items() if name != "pieces"
            },
        }

    @contextlib.contextmanager
    def playing(self) -> Iterator[tuple[Env, Play]]:
        """Give the environment that is recorded, and what plays a performance in one like it."""
        with torch_computing(1), warnings.catch_warnings(), contextlib.ExitStack() as opened:
            warnings.simplefilter("ignore", PlanWarning)  # scores tell it, of thousands of pieces
            players = {
                name: opened.enter_context(open_player(self.config, name))
                for name in self.config.players
            }

            def play(number: int) -> tuple[EpisodeBuffer, Notes]:
                what = self.config.performance(number)
                policy, env = players[what.player]
                noise = (
                    ActuatorNoise(env, what.noise, self.config.noise_memory) if what.noise else None
                )
                episode, notes = play_episode(policy, env, what.seed, noise, {"score": what.score})
                facts = {"performance": float(number), "seed": float(what.seed)}
                names = {"piece": what.piece, "title": what.score.title, "player": what.player}
                return episode, {**facts, **names, "noise": what.noise, **notes}

            yield players[self.config.players[0]][1], play


@contextlib.contextmanager
def open_player(config: CorpusConfig, name: str) -> Iterator[tuple[Player, Env]]:
    """Give a player and where it plays, as long as the block lasts.

    Raises:
        ConfigError: If it cannot play there.
        RunError: If a run cannot be loaded.
    """
    spec = PlayerSpec.parse(name)
    if spec.name == "sampling":
        one_core = {"n_threads": 1, **spec.arguments}  # as each process has
        spec = dataclasses.replace(spec, arguments=one_core)
    options = {"observation": "fingers", "physics": "fast", **config.env_kwargs}
    if config.by_hand:
        options |= _BY_HAND
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
        raise ConfigError(f"The run '{run}' is no piano's: expected one, for a corpus.")
    other = piano.default_score.stretch(1.5)
    env.reset(seed=0, options={"score": other})
    if not np.isclose(piano.score.duration, other.duration):
        raise ConfigError(
            f"The run '{run}' has wrappers that choose what it plays: expected one without, for "
            "a corpus."
        )
