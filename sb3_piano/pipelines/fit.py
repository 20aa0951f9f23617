"""Check of a curriculum before it is trained: do its stages fit each other."""

from __future__ import annotations

import contextlib
from typing import Any, NamedTuple

import gymnasium as gym

from sb3_piano.exceptions import ConfigError, SB3PianoError
from sb3_piano.pipelines.stages import Curriculum
from sb3_piano.training.configuration.config import RunConfig


class _Interface(NamedTuple):
    """What has to be equal where one run starts from another."""

    observation_space: gym.Space[Any]
    action_space: gym.Space[Any]
    normalize: bool

    @classmethod
    def of(cls, config: RunConfig) -> _Interface:
        """Return that of the settings of a run."""
        with contextlib.closing(config.env.make()) as env:
            return cls(env.observation_space, env.action_space, config.normalize is not False)


def check_fit(curriculum: Curriculum, begun: int = 0) -> None:
    """Make the environments of all stages but for those that have begun, and the last of these.

    Raises:
        ConfigError: If a setting is invalid, or a stage cannot start from the one before.
    """
    before: tuple[RunConfig, _Interface] | None = None
    for number, stage in list(enumerate(curriculum.stages, start=1))[max(begun - 1, 0) :]:
        try:
            config = stage.run_config(curriculum.algo)
            interface = _Interface.of(config)
            if before is not None:
                _check_step(before[1], interface)
                if stage.with_buffer:
                    _check_buffer(before[0], config)
        except SB3PianoError as error:
            raise ConfigError(f"Stage {number}: {error}") from error
        before = config, interface


def _check_step(before: _Interface, after: _Interface) -> None:
    for name, theirs, ours in zip(_Interface._fields, before, after, strict=True):
        if theirs != ours:
            raise ConfigError(
                f"Its {name} is {ours}, that of the stage before {theirs}: expected equal ones, of "
                "the same wrappers and an observation that does not go by the piece, such as "
                "'roll'."
            )


def _check_buffer(before: RunConfig, after: RunConfig) -> None:
    theirs, ours = ((c.n_envs, c.algorithm_kwargs.get("buffer_size")) for c in (before, after))
    if theirs != ours:
        raise ConfigError(
            f"with_buffer is true, but n_envs and buffer_size are {ours[0]} and {ours[1]}, of the "
            f"stage before {theirs[0]} and {theirs[1]}: expected equal ones, or no with_buffer."
        )
