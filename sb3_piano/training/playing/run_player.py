"""Open a run's model in the run's environment."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import gymnasium as gym
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from sb3_piano.callbacks.own_env import EnvWrapper
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RunError, ScoreError
from sb3_piano.music import Score, load_score
from sb3_piano.players import EpisodeRecorder, PlayerSpec, TreeSearch
from sb3_piano.players.policy import singles_of
from sb3_piano.training.playing.player import OpenPlayer, Source, closed_if_it_fails
from sb3_piano.training.runs.builders import Env, build_vec_env
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import (
    load_statistics,
    load_to_play,
    model_files,
)


def open_run(
    spec: PlayerSpec,
    run: RunFolder,
    seed: int,
    physics: str | None,
    score: Source | None,
    best: str | None,
    disturbed: EnvWrapper | None,
) -> OpenPlayer:
    """Open a run's model in its environment; see :meth:`OpenPlayer.open`."""
    trained = run.read_config()
    config = dataclasses.replace(trained.alone(), seed=seed)
    if physics is not None:
        config = config.in_env(physics=physics)
    chosen = None if score is None else load_score(score)
    model_file, statistics = model_files(run, config, best)

    def innermost(env: Env) -> EpisodeRecorder:
        env = env if disturbed is None else disturbed(env)
        return EpisodeRecorder(env if chosen is None else _FixedPiece(env, chosen))

    venv = build_vec_env(config, innermost)
    with closed_if_it_fails(venv):
        load_statistics(config, statistics, venv)
        if isinstance(venv, VecNormalize):
            venv.training = False
        env = singles_of(venv)[0]
        if chosen is not None:
            _check_playable(run, env, venv, chosen)
        model: Any = load_to_play(config, model_file, venv)
        if spec.tree is not None:
            model = TreeSearch(model, venv, spec.tree, seed=seed)
        return OpenPlayer.playing(
            model,
            venv,
            spec,
            config.env,
            seed,
            algo=config.algo,
            run=run,
            training_seed=trained.seed,
            titles={} if chosen is not None else titles_of_copies(run, env),
            piece=None if chosen is None else chosen.title,
        )


class _FixedPiece(gym.Wrapper[Any, Any, Any, Any]):
    """Wrapper that plays one fixed piece, whatever piece outer wrappers choose."""

    def __init__(self, env: Env, score: Score):
        super().__init__(env)
        self._score = score

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of the piece."""
        others = {k: v for k, v in (options or {}).items() if k != "transform"}
        return self.env.reset(seed=seed, options={**others, "score": self._score})


def _check_playable(run: RunFolder, env: Env, venv: VecEnv, score: Score) -> None:
    if not isinstance(env.unwrapped, PianoEnv):
        raise ConfigError(
            f"Run '{run.path}' cannot play {score.title!r}: its environment "
            f"{run.read_config().env_id!r} is no piano. Expected a run of a piano environment, or "
            "no piece."
        )
    try:
        venv.reset()
    except ScoreError as error:
        raise RunError(
            f"Run '{run.path}' cannot play {score.title!r}: {error} Expected a piece that its "
            "observation can show."
        ) from error


def titles_of_copies(run: RunFolder, env: Env) -> dict[str, str]:
    """Return the original name of a score file copied into a run's folder, by the copy's title."""
    file, piano = run.read_provenance().get("score_file"), env.unwrapped
    if isinstance(file, str) and isinstance(piano, PianoEnv):
        return {piano.default_score.title: Path(file).stem}
    return {}
