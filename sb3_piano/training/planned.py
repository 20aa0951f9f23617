"""Runs, and single performances, of what plays without any training."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym

from sb3_piano.envs import GENERAL_ID, EpisodeRecorder, PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Score, is_path
from sb3_piano.training.builders import build_planner
from sb3_piano.training.config import RunConfig
from sb3_piano.training.play import take_of_recording
from sb3_piano.training.recording import env_to_record
from sb3_piano.training.run_folder import RunFolder
from sb3_piano.viewing import Take

PLANNED_IN: Mapping[str, Any] = {
    "reduced_action_space": False,
    "initial_buffer_time": 0.5,
    "fingering": "robot",
}
"""Options of the environments in which planners play unless told otherwise: all joints, half a
second to get to the first note, and the fingers that suit the hands."""


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """What :func:`plan_run` made."""

    folder: RunFolder
    """The run's folder."""
    piece: str
    """What is played."""
    planning: float
    """How long it took to plan it, s."""


@dataclass(frozen=True, kw_only=True)
class PlannedTake:
    """What :func:`take_of_planner` played."""

    take: Take
    """What there is to see and hear."""
    score: Score
    """What should have been played."""
    metrics: Mapping[str, float]
    """How well it was played, by the names in ``info``."""
    planning: float
    """How long it took until the first command, s."""
    playing: float
    """How long the others took, s."""


def where_played(what: str) -> tuple[str, dict[str, Any]]:
    """Return the environment that plays something, and the options that it needs for that.

    Args:
        what: An environment's id, a file such as MIDI, or a piece by its name.

    Raises:
        ConfigError: If it looks like a file and there is none.
    """
    if what in gym.registry:
        return what, {}
    if is_path(what) and not Path(what).exists():
        raise ConfigError(
            f"There is no {what!r}: expected an environment's id, a file such as a MIDI file, or "
            "the name of a piece (see 'sb3-piano pieces list')."
        )
    return GENERAL_ID, {"score": what}


def planner_config(
    what: str,
    algo: str = "planned",
    *,
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    **arguments: Any,
) -> RunConfig:
    """Return the settings of a run that plays without training.

    Args:
        what: An environment's id, a file such as MIDI, or a piece by its name.
        algo: One of :data:`~sb3_piano.training.PLANNERS`.
        seed: Seeds the environment and what is drawn at random, at least 0.
        env_kwargs: Options of the environment, beside and before those of :data:`PLANNED_IN`.
        **arguments: Arguments of the planner, such as ``samples``; in plain values, mappings for
            its settings.

    Raises:
        ConfigError: If there is no such file, or an argument is unknown or does not fit.
    """
    env_id, options = where_played(what)
    return RunConfig(
        algo=algo,
        env_id=env_id,
        n_timesteps=1,  # that nobody takes
        seed=seed,
        env_kwargs={**PLANNED_IN, **options, **(env_kwargs or {})},
        algorithm_kwargs=arguments,
    )


def plan_run(
    config: RunConfig,
    folder: str | os.PathLike[str] | None = None,
    *,
    runs_dir: str | os.PathLike[str] = "runs",
) -> PlannedRun:
    """Make the folder of a run that plays without training, once it is known to work.

    The plan is made, so that a :class:`~sb3_piano.exceptions.PlanWarning` tells what cannot be
    played; it is not kept, as making it again takes seconds.

    Args:
        config: What :func:`planner_config` returned.
        folder: The run's folder, new or empty; by default the next free one in ``runs_dir``.
        runs_dir: Where runs are kept.

    Raises:
        ConfigError: If environment or planner refuse their settings, or it is no piano.
        RunError: If the folder cannot be used.
        ScoreError: If the piece cannot be read or planned.
    """
    run = RunFolder.create(config, folder, runs_dir)
    try:
        with contextlib.closing(env_to_record(config)) as env:
            player = build_planner(config, env)
            observation, _ = env.reset(seed=config.seed)
            start = time.perf_counter()
            player.predict(observation)
            seconds = time.perf_counter() - start
            assert isinstance(env.unwrapped, PianoEnv), "planners play nothing else"
            return PlannedRun(folder=run, piece=env.unwrapped.score.title, planning=seconds)
    except BaseException:
        shutil.rmtree(run.path, ignore_errors=True)
        raise


def take_of_planner(
    config: RunConfig, on_step: Callable[[int, int], object] = lambda done, total: None
) -> PlannedTake:
    """Play a piece without training and without a run's folder.

    Args:
        config: What :func:`planner_config` returned.
        on_step: Is told how many control steps are over, and of how many. The first call, with 0,
            comes before planning.

    Raises:
        ConfigError: If environment or planner refuse their settings, or it is no piano.
        ScoreError: If the piece cannot be read or planned.
    """
    with contextlib.closing(EpisodeRecorder(env_to_record(config))) as env:
        player = build_planner(config, env)
        piano = env.unwrapped
        assert isinstance(piano, PianoEnv), "planners play nothing else"
        observation, _ = env.reset(seed=config.seed)
        on_step(0, len(piano.roll))
        began = time.perf_counter()
        action, state = player.predict(observation)
        planned = time.perf_counter()
        while True:
            observation, *_ = env.step(action)
            on_step(piano.steps_played, len(piano.roll))
            if env.finished:
                break
            action, state = player.predict(observation, state)
        ended = time.perf_counter()
        (recording,) = env.finished
        return PlannedTake(
            take=take_of_recording(piano.scene, recording),
            score=piano.score,
            metrics=recording.metrics,
            planning=planned - began,
            playing=ended - planned,
        )
