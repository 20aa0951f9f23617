"""A run's saved model, or what plays in it without training, ready to play."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize

from sb3_piano.callbacks.own_env import EnvWrapper
from sb3_piano.demonstrations import PerturbedStart
from sb3_piano.demonstrations.recording import Predictor
from sb3_piano.envs import EpisodeRecorder, PianoEnv, Recording
from sb3_piano.exceptions import ConfigError, RunError, ScoreError
from sb3_piano.files import read_file, write_bytes
from sb3_piano.jobs.folders import unwritable
from sb3_piano.layers import layers
from sb3_piano.music import Score, load_score
from sb3_piano.planning import PianoPolicy
from sb3_piano.players import HandModel, TreeSearch, TreeSettings
from sb3_piano.settings import Count, Index, checked
from sb3_piano.threads import torch_computing
from sb3_piano.training.configuration.config import PlannedConfig, PlayConfig, RunConfig
from sb3_piano.training.configuration.env_spec import BASE
from sb3_piano.training.runs.builders import (
    Env,
    build_planner,
    build_vec_env,
    one_env,
    refuse_other_vectors,
)
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import (
    act,
    load_statistics,
    load_to_play,
    model_files,
    pack_weights,
)
from sb3_piano.wrappers.residual import Residual
from sb3_piano.wrappers.score_wrapper import possible_scores


@dataclass(kw_only=True, eq=False)
class SavedPlayer(contextlib.AbstractContextManager["SavedPlayer"]):
    """The saved model of a run in its own environment, playing without exploring.

    The environment has the run's wrappers and normalisation; what is recorded is that of the bare
    environment inside::

        with SavedPlayer.open("runs/td3/RoboPianist-v0_1") as player:
            recordings = player.play(episodes=3)

    :meth:`open` makes one.
    """

    run: RunFolder
    """The run's folder."""
    config: PlayConfig
    """The run's settings as they are played: one environment, the given physics."""
    piece: str
    """The name of what is played, of several pieces joined by "or"; the environment's id if it is
    no piano."""
    model: BaseAlgorithm | PianoPolicy
    """The saved model, or what plays without training."""
    _titles: Mapping[str, str]
    """Titles of scores whose files were copied, by the titles of the copies."""
    _venv: VecEnv
    _recorder: EpisodeRecorder

    @classmethod
    def open(
        cls,
        folder: str | os.PathLike[str],
        *,
        seed: int = 0,
        physics: str | None = None,
        score: Score | str | os.PathLike[str] | None = None,
        best: str | None = None,
        tree: TreeSettings | None = None,
        disturbed: EnvWrapper | None = None,
    ) -> SavedPlayer:
        """Return the player of a run.

        Another piece comes in through the environment's ``reset``, so that an observation that
        was fitted to the run's own piece keeps its meaning. Arguments are those of
        :func:`~sb3_piano.training.play_run`; :meth:`play` may be given another seed. ``disturbed``
        is put around the bare environment.

        Raises:
            ConfigError: If ``seed`` is out of range, the run's config is damaged, or a piece is
                given to an environment that is no piano.
            RunError: If there is no run, it has no model that can be loaded, or what it observes
                cannot show the piece.
            ScoreError: If the score cannot be read.
        """
        run = RunFolder.open(folder)
        config = dataclasses.replace(run.read_config().alone(), seed=seed)
        if physics is not None:
            config = config.in_env(physics=physics)
        chosen = None if score is None else load_score(score)
        model_file, statistics = model_files(run, config, best)

        def innermost(env: Env) -> EpisodeRecorder:
            env = env if disturbed is None else disturbed(env)
            return EpisodeRecorder(env if chosen is None else _FixedPiece(env, chosen))

        if isinstance(config, RunConfig):
            venv = build_vec_env(config, innermost)
        else:
            venv = one_env(config.env, config.seed, innermost)
        try:
            load_statistics(config, statistics, venv)
            if isinstance(venv, VecNormalize):
                venv.training = False
            env = cast(DummyVecEnv, venv.unwrapped).envs[0]
            if chosen is not None:
                _check_playable(run, config, env, venv, chosen)
            model = load_to_play(config, model_file, venv)
            if tree is not None:
                model = TreeSearch(model, venv, tree, seed=seed)
            titles = {} if chosen is not None else titles_of_copies(run, env)
            return cls(
                run=run,
                config=config,
                piece=_own_piece(config, env, titles) if chosen is None else chosen.title,
                model=model,
                _titles=titles,
                _venv=venv,
                _recorder=[e for e in layers(env) if isinstance(e, EpisodeRecorder)][-1],
            )
        except BaseException:
            venv.close()
            raise

    @property
    def env(self) -> Env:
        """The bare environment."""
        return self._recorder.unwrapped

    @property
    def vec_env(self) -> VecEnv:
        """The vector that the model plays in, with the run's wrappers and normalisation."""
        return self._venv

    @property
    def num_timesteps(self) -> int:
        """Environment steps that the model was trained for."""
        return self.model.num_timesteps

    def play(self, episodes: int = 1, *, seed: int | None = None) -> list[Recording]:
        """Play so many episodes from a freshly seeded environment.

        The seed, at least 0, is by default that of :meth:`open`.

        Raises:
            ConfigError: If a number is out of range.
        """
        count = checked("episodes", episodes, Count)
        return list(itertools.islice(self.episodes(seed=seed), count))

    def episodes(self, *, seed: int | None = None) -> Iterator[Recording]:
        """Play as :meth:`play` does without end, each episode as it is asked for.

        Whatever is played next, or a rest, ends it.
        """
        return self._record(seed, resting=False)

    def rest(self) -> Recording | None:
        """Return an episode in which the hands rest; ``None`` if the environment is no piano."""
        return next(self._record(None, resting=True)) if self._recorder.can_rest else None

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[Any] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return what the model plays for an observation as the environment gives it."""
        with torch_computing():
            return act(self.model, self._venv, observation, state, episode_start, deterministic)

    def close(self) -> None:
        """Close the environment."""
        self._venv.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _record(self, seed: int | None, *, resting: bool) -> Iterator[Recording]:
        seed = checked("seed", self.config.seed if seed is None else seed, Index | None)
        self._recorder.resting = resting
        if isinstance(self.model, PianoPolicy):
            self.model.set_random_seed(seed or 0)
        self._venv.seed(seed)
        observation = self._venv.reset()
        self._recorder.finished.clear()  # an episode that was left under way ends here
        return self._endless(observation)

    def _endless(self, observation: Any) -> Iterator[Recording]:
        action, state, starts = None, None, np.ones(1, dtype=bool)
        while True:
            # While the hands rest, nobody hears what is asked; to search for it would take long.
            if action is None or not self._recorder.resting:
                with torch_computing():
                    action, state = self.model.predict(observation, state, starts, True)
            observation, _, starts, _ = self._venv.step(action)
            if self._recorder.finished:
                yield self._titled(self._recorder.finished.pop())

    def _titled(self, recording: Recording) -> Recording:
        performance = recording.performance
        if performance is None or performance.title not in self._titles:
            return recording
        named = dataclasses.replace(performance, title=self._titles[performance.title])
        return dataclasses.replace(recording, performance=named)


class _FixedPiece(gym.Wrapper[Any, Any, Any, Any]):
    """Play one piece, whatever the wrappers further out ask for."""

    def __init__(self, env: Env, score: Score):
        super().__init__(env)
        self._score = score

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of the piece."""
        others = {k: v for k, v in (options or {}).items() if k != "transform"}
        return self.env.reset(seed=seed, options={**others, "score": self._score})


def _check_playable(
    run: RunFolder, config: PlayConfig, env: Env, venv: VecEnv, score: Score
) -> None:
    if not isinstance(env.unwrapped, PianoEnv):
        raise ConfigError(
            f"Run '{run.path}' cannot play {score.title!r}: its environment {config.env_id!r} is "
            "no piano. Expected a run of a piano environment, or no piece."
        )
    try:
        venv.reset()
    except ScoreError as error:
        raise RunError(
            f"Run '{run.path}' cannot play {score.title!r}: {error} Expected a piece that its "
            "observation can show."
        ) from error


def titles_of_copies(run: RunFolder, env: Env) -> dict[str, str]:
    """Return the name of the file that was copied into a run's folder, by the copy's title."""
    file, piano = run.read_provenance().get("score_file"), env.unwrapped
    if isinstance(file, str) and isinstance(piano, PianoEnv):
        return {piano.default_score.title: Path(file).stem}
    return {}


def _own_piece(config: PlayConfig, env: Env, titles: Mapping[str, str]) -> str:
    """Return what a run's own piece is called; all that wrappers may choose are named."""
    if not isinstance(env.unwrapped, PianoEnv):
        return config.env_id
    if isinstance(config, RunConfig) and len(config.pieces) > 1:
        return f"{len(config.pieces)} pieces"
    played = dict.fromkeys(titles.get(s.title, s.title) for s in possible_scores(env))
    return " or ".join(played) or config.env_id


@contextlib.contextmanager
def run_to_record(
    folder: str | os.PathLike[str], *, best: str | None = None, start: float = 0.0
) -> Iterator[tuple[Predictor, Env, PlayConfig]]:
    """Give a run's player, an environment with the run's wrappers, and its settings.

    They are for :func:`~sb3_piano.demonstrations.record`, as long as the block lasts; the hands
    begin out of place by ``start``, rad. Of a run that corrects another one, the environment is
    that without the correction, and the player plays the corrected actions in it.
    """
    config = RunFolder.open(Path(folder).absolute()).read_config()  # a data set lies elsewhere
    refused = f"Run '{folder}' cannot be recorded"
    if isinstance(config, RunConfig):
        refuse_other_vectors(config, refused)
    with (
        SavedPlayer.open(folder, best=best) as player,
        contextlib.closing(env_to_record(config, start)) as env,
    ):
        residual = next((layer for layer in layers(env) if isinstance(layer, Residual)), None)
        if residual is not None:
            _check_nothing_between(residual, env, refused)
            yield _Corrected(player, residual), residual.env, config
            return
        if isinstance(config, PlannedConfig):  # such play only where they are made for
            yield build_planner(config, env), env, config
        else:
            yield player, env, config


@dataclass(frozen=True, eq=False)
class _Corrected:
    """Player of a correction and of what it corrects, together."""

    player: SavedPlayer
    residual: Residual

    def predict(self, observation: Any, *arguments: Any, **named: Any) -> tuple[Any, Any]:
        """Return what they play."""
        correction, state = self.player.predict(observation, *arguments, **named)
        return self.residual.corrected(observation, correction), state


def _check_nothing_between(residual: Residual, env: Env, refused: str) -> None:
    """Refuse wrappers around a correction that change its observations or its actions."""
    for name in ("observation_space", "action_space"):
        if getattr(env, name) is not getattr(residual, name):  # a wrapper has its own
            raise ConfigError(
                f"{refused}: it has wrappers that change the {name} around the "
                f"{type(residual).__name__}. Expected none."
            )


def _hand_model(player: SavedPlayer) -> HandModel | None:
    """Return the network of a hand; ``None`` if the run has learnt something else."""
    assert isinstance(player.model, BaseAlgorithm), "what is trained has weights"
    env = cast(DummyVecEnv, player._venv.unwrapped).envs[0]
    try:
        return HandModel.of(player.model.policy, env, player.num_timesteps)
    except ConfigError:  # another policy, other actions, or another observation
        return None


def env_to_record(config: PlayConfig, start: float = 0.0) -> Env:
    """Return a run's environment with its wrappers, and none that ``gymnasium.make`` cannot make.

    Its hands begin out of place by ``start``, rad.
    """
    return config.env.make((lambda env: PerturbedStart(env, start)) if start else None)


def keep_base(run: RunFolder, config: PlayConfig) -> None:
    """Keep a copy of the run that is corrected, if one is, in the folder of the new run."""
    if config.env.base is not None:
        write_player(config.env.base, run.base_dir)
        run.write_config(run.read_config().with_files({BASE: str(run.base_dir)}))


def write_player(
    run: str | os.PathLike[str], folder: str | os.PathLike[str], *, best: str | None = None
) -> RunFolder:
    """Write what playing a run needs: its settings, origin, score and weights, in plain files.

    If it learnt one network for both hands (a policy for hands, acting by
    :class:`~sb3_piano.wrappers.HandActions`), that is written as well: ``hand.safetensors`` plays
    any piece as a :class:`~sb3_piano.players.SightReader`. Arguments and errors are those of
    :func:`~sb3_piano.training.export_run`, which adds what describes the run.
    """
    with player_written(run, folder, best) as written:
        return written


@contextlib.contextmanager
def player_written(
    run: str | os.PathLike[str], folder: str | os.PathLike[str], best: str | None
) -> Iterator[RunFolder]:
    """Give the folder of :func:`write_player`, which the block completes."""
    with contextlib.ExitStack() as made:
        with SavedPlayer.open(run, best=best) as player:
            config = player.run.read_config()
            written = made.enter_context(RunFolder.making(config, folder))
            try:
                keep_base(written, config)
                written.keep_pieces()
                if player.run.provenance_file.is_file():
                    write_bytes(written.provenance_file, read_file(player.run.provenance_file))
                if isinstance(config, RunConfig):
                    assert isinstance(player.model, BaseAlgorithm), "what is trained has weights"
                    write_bytes(written.weights_file, pack_weights(player.model, config))
                    hand = _hand_model(player)
                    if hand is not None:
                        hand.save(written.hand_file)
            except OSError as error:
                raise unwritable(written.path, error) from error
        yield written
